"""Matrix fractions, modal models and fits of records."""

from __future__ import annotations

import numpy as np

import robustid as rid
from robustid.fitting import subspace_estimate

from .plants import HIGH, HZ, driven, modal_system, noisy
from .registry import of, problem

FIT = "cost start_cost status poles model stable reflected condition_numbers decoupling"


def facts(fit):
    return of(fit, FIT) | {"steps": len(fit.history)}


def data(**names):
    return noisy(modal_system(), HIGH, **names)


def small(dt=None):
    model = modal_system(seed=5, outputs=1, inputs=1, modes=2, band_hz=(10.0, 150.0))
    return noisy(model.sample(dt) if dt else model, HZ * np.linspace(4, 230, 60))


@problem(quick=True)
def fit_right_and_left(_):
    return {form: facts(rid.fit_mfd(data(), order=6, form=form)) for form in ("right", "left")}


@problem()
def fit_discrete(_):
    frf = small(dt=1 / 500)
    return {
        "lm": facts(rid.fit_mfd(frf, order=4)),
        "feedthrough": facts(rid.fit_mfd(frf, order=5, feedthrough=True)),
        "in s": facts(rid.fit_mfd(small(), order=4)),
        "iv": facts(rid.fit_mfd(frf, order=4, method="iv")),
    }


@problem()
def fit_weights(_):
    frf = data()
    covariance = np.eye(4) * (0.01 * np.abs(frf.values.transpose(0, 2, 1).reshape(-1, 1, 4))) ** 2
    known = rid.FrequencyResponse(frf.omega, frf.values, covariance=covariance)
    weighted = {
        "relative": rid.fits.Weight(1 / np.abs(frf.values)),
        "full": rid.fits.Weight.from_covariance(covariance, 2, 2),
    }
    found = {name: facts(rid.fit_mfd(frf, order=6, weight=one)) for name, one in weighted.items()}
    fit = rid.fit_mfd(known, order=6)
    spread = rid.fits.fit_covariance(fit)
    return found | {
        "known": facts(fit),
        "choice": str(rid.fit_mfd(frf, order=6).weight_choice),
        "covariance": of(spread, "variance poles pole_std hz hz_std damping damping_std"),
        "response": spread.response_std(HIGH[::20]),
    }


@problem(quick=True)
def fit_rigid_body(_):
    frf = data()
    s = 1j * frf.omega
    rigid = np.array([[1.0], [-0.3]]) @ np.array([[2.0, 1.0]]) * 1e4 / (s**2)[:, None, None]
    fit = rid.fit_mfd(rid.FrequencyResponse(frf.omega, frf.values + rigid), order=8, rigid_body=rid.RigidBody(1))
    return facts(fit) | of(fit, "rigid_directions")


@problem()
def fit_constraints(_):
    frf = small()
    wanted = [rid.fits.StaticGain([[1.0]]), rid.fits.RollOff(2)]
    return {
        "static gain": facts(rid.fit_mfd(frf, order=4, constraints=wanted[:1])),
        "roll-off": facts(rid.fit_mfd(frf, order=4, constraints=wanted[1:])),
        "zero": facts(rid.fit_mfd(frf, order=4, constraints=[rid.fits.Zero(300.0j)])),
        "entries": facts(
            rid.fit_mfd(data(), order=6, constraints=[rid.fits.ZeroEntries([[False, True], [False, False]])])
        ),
    }


@problem(quick=True)
def fit_modal(_):
    plain = data(inputs=["force [N]", "torque [Nm]"])
    return {
        "general": facts(rid.fit_mfd(plain, order=6, modal=True)),
        "proportional": facts(rid.fit_mfd(plain, order=6, modal=rid.fits.Modal("proportional"))),
    }


@problem(quick=True)
def modal_forms(_):
    fit = rid.fit_mfd(data(), order=6)
    form = rid.fits.modal_form(fit.model)
    rows = [
        of(row, "pole hz damping rigid multiplicity participation output input") for row in rid.fits.mode_table(fit)
    ]
    return {"model": form.model, "blocks": [str(b) for b in form.blocks], "error": form.error, "rows": rows}


@problem(loose=("subspace_order", "singular_values", "noise_edge", "summary"))
def orders(_):
    found = rid.fits.suggest_order(small(), orders=range(2, 7), time_limit=None)
    return of(
        found,
        "orders suggested subspace_order costs parameters aic mdl singular_values noise_edge unresolved reason summary",
    )


@problem()
def fit_of_records(_):
    records = [driven(150), driven(100, seed=1, initial="rest")]
    fit = rid.fit_records(records, order=3)
    moved = rid.fit_records(records[0], order=3, offset=True, delay=0.0)
    names = "cost record_cost status poles model fit_percent offsets stable"
    return {"two": of(fit, names) | {"states": fit.initial_states}, "offset": of(moved, names)}


@problem(quick=True)
def subspace(_):
    frf = data()
    found = subspace_estimate(frf.values, 1j * frf.omega, 6)
    sampled = small(dt=1 / 500)
    z = subspace_estimate(sampled.values, np.exp(1j * sampled.omega / 500), 4, domain="z")
    return {
        name: {"poles": np.sort_complex(np.linalg.eigvals(one.A)), "singular values": one.singular_values}
        for name, one in {"s": found, "z": z}.items()
    }


@problem(quick=True)
def modal_covariance(_):
    frf = data()
    covariance = np.eye(4) * (0.01 * np.abs(frf.values.transpose(0, 2, 1).reshape(-1, 1, 4))) ** 2
    fit = rid.fit_mfd(rid.FrequencyResponse(frf.omega, frf.values, covariance=covariance), order=6, modal=True)
    spread = rid.fits.fit_covariance(fit)
    names = "hz_std damping_std shape drive shape_std drive_std participation"
    return {
        "rows": [of(row, names) for row in rid.fits.mode_table(fit, spread)],
        "response": spread.response_std(HIGH[::20]),
    }
