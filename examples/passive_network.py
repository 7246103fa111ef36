"""Scattering parameters of a network to a passive model with a proof, a subcircuit and a file for others' programs.

The ring slot between two waveguides that scikit-rf ships (75 to 110 GHz, two ports); where scikit-rf isn't installed, a ladder
filter with 0.1 % noise.
Passive networks have a scattering matrix of norm at most 1 at all frequencies. A fit knows nothing of it: it is beyond 1 where
nothing was measured, or by noise, and a circuit simulator may then oscillate. The nearest passive model is found, with
a matrix that proves it at all frequencies, the one of half its order, and what each costs at the data.
Run: python passive_network.py --out folder (about 10 s)
"""

import argparse
import tempfile
from pathlib import Path

import control
import matplotlib.pyplot as plt
import numpy as np

import robustid as rid

POLES = 4  # shared by all entries: two states each
LADDER = (1.0, 2.0, 1.5, 0.5)  # H and F in turn between two ports of 1 ohm


def ladder():
    """Scattering parameters of a ladder of coils with resistance and capacitors, by its nodal equations, with noise."""
    omega = np.linspace(0.02, 3.0, 120)
    eye, values = np.eye(2), np.empty((omega.size, 2, 2), complex)
    for k, w in enumerate(omega):
        chain = np.eye(2)
        for number, size in enumerate(LADDER):
            series, shunt = (0.05 + 1j * w * size, 0) if number % 2 == 0 else (0, 1j * w * size)
            chain = chain @ [[1 + series * shunt, series], [shunt, 1]]
        (a, _), (c, d) = chain
        impedance = np.array([[a, 1], [1, d]]) / c
        values[k] = (impedance - eye) @ np.linalg.inv(impedance + eye)
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((2, *values.shape))
    return "ladder", 1.0, rid.FrequencyResponse(omega, values + 1e-3 * (noise[0] + 1j * noise[1]) / np.sqrt(2))


def data_to_use():
    """A name, a reference resistance and the response."""
    try:
        import skrf
    except ImportError:
        return ladder()
    return "ring slot", 50.0, rid.load(Path(skrf.__file__).parent / "data" / "ring slot.s2p")


def values(model, omega):
    """The response of a model, (F, ny, nu)."""
    return np.array([model(1j * w) for w in omega])


def largest(model, omega):
    """Largest singular values."""
    return np.linalg.norm(values(model, omega), 2, axis=(1, 2))


def main():
    """Fit, make passive, reduce, write, draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=None)
    folder = parser.parse_args().out or Path(tempfile.mkdtemp(prefix="robustid-"))
    folder.mkdir(parents=True, exist_ok=True)
    name, reference, data = data_to_use()
    print(
        f"1. {name}: {data.omega.size} lines, {data.omega[0] / 2 / np.pi:.4g} to {data.omega[-1] / 2 / np.pi:.4g} Hz, two ports."
    )

    fit = rid.fit_mfd(data, order=POLES, form="shared", feedthrough=True, weight=np.ones(data.values.shape)).model
    doubled = control.StateSpace(
        fit.A, fit.B, 1.01 * fit.C, 1.01 * fit.D, 0
    )  # such as a calibration error of 1 % makes
    models = {"fit": fit, "fit, 1 % too large": doubled}
    models["passive"] = (passive := rid.passive.make_passive(fit, response=data)).model
    models["passive, from 1 % too large"] = rid.passive.make_passive(doubled).model
    models["passive, half the order"] = rid.passive.reduce_passive(passive.model, order=fit.nstates // 2).model
    print(f"2. {'':28} order  rms error  passive")
    for label, model in models.items():
        proof = rid.prove_passive(model)
        error = np.sqrt(np.mean(np.abs(values(model, data.omega) - data.values) ** 2))
        said = (
            f"yes: norm <= 1 - {proof.margin:.1e} at all frequencies"
            if proof.holds
            else proof.status.value.split(":")[0]
        )
        print(f"   {label:28} {model.nstates:5d}  {error:9.2e}  {said}")
        for band in proof.bands:
            ends = " to ".join("infinity" if np.isinf(w) else f"{w / 2 / np.pi:.4g} Hz" for w in band[:2])
            print(f"   {'':45}1 + {band.amount:.2e} at most, {ends}")

    rid.save(folder / "passive.s2p", passive.model, reference=reference, omega=data.omega)
    rid.save(folder / "passive.cir", passive.model, reference=reference)
    print(f"3. Written to {folder}: passive.s2p, passive.cir (a SPICE subcircuit), the picture.")

    figure, panels = plt.subplots(2, 1, figsize=(7, 6), layout="constrained")
    hz = data.omega / (2 * np.pi)
    for i, j, colour in ((0, 0, "C0"), (1, 0, "C1")):
        panels[0].plot(hz, np.abs(data.values[:, i, j]), ".", color=colour, label=f"data, S{i + 1}{j + 1}")
        panels[0].plot(hz, np.abs(values(passive.model, data.omega)[:, i, j]), color=colour, label="passive model")
    wide = data.omega[-1] * np.geomspace(0.05, 20, 400)
    for label in ("fit, 1 % too large", "passive", "passive, half the order"):
        panels[1].semilogx(wide / (2 * np.pi), largest(models[label], wide), label=label)
    panels[1].axhline(1, color="black", linewidth=0.8)
    panels[0].set(xlabel="frequency [Hz]", ylabel="size")
    panels[1].set(xlabel="frequency [Hz]", ylabel="largest singular value")
    for panel in panels:
        panel.legend(fontsize="small")
    figure.savefig(folder / "passive_network.png", dpi=150)


if __name__ == "__main__":
    main()
