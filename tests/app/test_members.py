"""Run files with [[members]]: one class for all, a family, its folder and page; and what is refused before anything is read."""

import dataclasses
import json

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.run import sequence
from robustid.app.run.run_file import read_run_file
from robustid.app.run.toml import write_toml
from robustid.core import Unfinished
from support.cases import slow
from support.families import DT, LINES, measured, truth
from support.faulty_files import CLASS_KEYS, response
from support.report_pages import Page

GAINS = {"weak": 0.8, "strong": 1.3}
CLASS = {"modes": {"hz": []}, "prior": {"gain_bound": 3.0, "decay_rate": 2.0}}
AT = {"at_hz": [float(w) for w in LINES[:2] / (2 * np.pi)], "directions": 4}


def asked(folder, gains=None, bound=0.02, **sections):
    gains, lines = gains or GAINS, []
    for k, (name, gain) in enumerate(gains.items()):
        rid.save(folder / f"{name}.csv", measured(gain, seed=k, bound=bound))
        lines += [
            f'[[members]]\nname = "{name}"\namplitude = {gain}\n[[frequency]]\nfile = "{name}.csv"\nmember = "{name}"'
        ]
        lines += [f"dt = {DT}"]
    for section, keys in (CLASS | {"worst_case": AT} | sections).items():
        lines += [f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
    (folder / "ask.toml").write_text("\n".join(lines))
    return folder / "ask.toml"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("members")
    return folder, rid.run(asked(folder, family={"interval": [0.5, 1.5]}), folder / "out")


def test_a_run_makes_the_family_that_is_made_by_hand(done):
    folder, found = done
    prior = rid.Prior(gain_bound=3.0, decay_rate=2.0)
    members = []
    for name, gain in GAINS.items():
        frf = rid.load(folder / f"{name}.csv", dt=DT)
        result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior))
        members.append(rid.guarantee.Member(result, name, amplitude=gain))
    hand = rid.family(members, omega=2 * np.pi * np.array(AT["at_hz"]), directions=4)
    assert np.array_equal(found.family.upper, hand.upper)
    assert found.family.names == ("weak", "strong")
    assert found.consistent
    assert not found.contradicted
    assert "Nothing is proved between amplitude 0.8 and 1.3, nor below amplitude 0.8" in found.summary()


def test_its_folder_holds_the_family_and_gives_it_again(done):
    folder, found = done
    assert np.array_equal(rid.load(folder / "out" / "family").upper, found.family.upper)
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    for words in ("Who drives the band where", "What is not known", "strong", "[[members]]"):
        assert words in page
    again = rid.run(folder / "out" / "run.toml", folder / "again")
    assert np.array_equal(again.family.upper, found.family.upper)
    assert again.findings == found.findings


def test_a_family_of_a_run_that_ctrl_c_ended_says_so_on_its_later_page(done, tmp_path):
    left_out = Unfinished(("bounding the error",), True, resumable=True)
    stopped = dataclasses.replace(done[1], unfinished=left_out)
    stopped.numbers["family"].save(tmp_path / "family")
    again = rid.load(tmp_path / "family")
    assert again.unfinished == dataclasses.replace(left_out, run="the run")
    assert done[1].numbers["family"].unfinished is None
    rid.write_report(again, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert 'id="unfinished"' in text


def test_one_controller_is_designed_for_all_members(tmp_path, monkeypatch, request):
    path = asked(tmp_path, controller={"structure": "PI", "peak": 1.8})
    found = rid.run(path, tmp_path / "out")
    assert found.design.status.name == "PROVED"
    assert found.findings[-1].startswith("Controller of order 1: bandwidth")
    assert found.summary().count("Controller of order 1") == 1
    omega = np.linspace(0.01, np.pi / DT, 2000)
    C = found.design.controller(np.exp(1j * omega * DT))
    for gain in GAINS.values():  # the plants themselves keep what is proved of all that the data allow
        assert np.abs(1 / (1 + truth(gain, omega) * C)).max() <= 1.8
        plant = control.tf([0.4 * gain, 0.3 * gain], [1, -0.2], DT)
        assert np.abs(control.feedback(plant, found.design.controller).poles()).max() < 1
    kept = rid.load(tmp_path / "out" / "controller")
    assert [one.band.problem.frequency[0].values[0, 0, 0] for one in kept.proofs] == [
        one.problem.frequency[0].values[0, 0, 0] for one in found.identifications.values()
    ]
    assert (tmp_path / "out" / "controller-model.npz").is_file()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for words in (
        "The controller that was designed",
        "Band 1 is that of weak; band 2 is that of strong.",
        "controller, band 2",
    ):
        assert words in page
    assert "at every frequency, for the plants of both bands" in found.summary()

    def refuse(*_, **__):
        raise AssertionError("it was designed before")

    monkeypatch.setattr("robustid.app.run.designed.design_controller", refuse)
    request.getfixturevalue("unpaged")
    again = rid.run(path, tmp_path / "out", resume=True)
    assert np.array_equal(again.design.controller.C, found.design.controller.C)


@pytest.mark.usefixtures("unpaged")
def test_the_class_is_chosen_once_for_all(tmp_path):
    found = rid.run(asked(tmp_path, bound=0.3, modes={"hz": []}, prior={}), tmp_path / "out")
    priors = [one.problem.prior for one in found.identifications.values()]
    assert priors[0] == priors[1]
    assert found.run_file.prior.note.startswith("One class for all members")
    assert found.consistent


@pytest.mark.usefixtures("unpaged")
def test_the_modes_are_those_of_a_fit_of_every_member(tmp_path):
    """One mode in members of different gain; the run file that is written gives the family again without a fit."""
    basis, omega = rid.kautz([8.0], [0.03], dt=DT, delay=1), np.linspace(5.0, 11.0, 12)
    path = asked(tmp_path, worst_case={"at_hz": [1.2], "directions": 4}, modes={}, fit={"order": 2})
    for k, (name, gain) in enumerate(GAINS.items()):
        error = 0.9e-3 * np.exp(2j * np.pi * np.random.default_rng(k).uniform(0, 1, omega.size))
        values = basis.response(omega * DT) @ np.array([0.1, 0.05]) * gain + error
        rid.save(tmp_path / f"{name}.csv", rid.FrequencyResponse(omega, values, bound=1e-3, dt=DT))
    found = rid.run(path, tmp_path / "out")
    modes = found.run_file.modes
    np.testing.assert_allclose((modes.hz[0], modes.damping[0]), (8.0 / (2 * np.pi), 0.03), rtol=0.02)
    assert "a matrix fraction of order 2" in modes.note
    assert "Of weak, the first of the members.\nstrong: 1.27" in modes.note
    assert found.consistent
    weak, strong = (found.identifications[name].problem.parametric.poles for name in GAINS)
    np.testing.assert_allclose(weak, strong, rtol=1e-3)
    assert not np.array_equal(weak, strong)
    fit = rid.load(tmp_path / "out" / "fit")
    assert rid.fits.mode_table(fit)[0].hz == modes.hz[0]
    again = rid.run(tmp_path / "out" / "run.toml", tmp_path / "again")
    assert np.array_equal(again.family.upper, found.family.upper)
    assert again.run_file.modes.note == modes.note


def moved(tmp_path, points=9, **sections):
    """Two members whose mode lies at 8.0 and 8.3 rad/s, each measured within 1e-3 of its plant."""
    omega, place = np.linspace(5.0, 11.0, points), {"weak": 8.0, "strong": 8.3}
    path = asked(tmp_path, worst_case={"at_hz": [1.29], "directions": 3, "over_poles": True}, **sections)
    for k, (name, at) in enumerate(place.items()):
        error = 0.9e-3 * np.exp(2j * np.pi * np.random.default_rng(k).uniform(0, 1, omega.size))
        values = rid.kautz([at], [0.03], dt=DT, delay=1).response(omega * DT) @ np.array([0.1, 0.05]) + error
        rid.save(tmp_path / f"{name}.csv", rid.FrequencyResponse(omega, values, bound=1e-3, dt=DT))
    return path, place


@pytest.mark.usefixtures("unpaged")
@pytest.mark.parametrize("modes", [{}, slow({"hz": [1.28], "damping": [0.03], "delay": 1})])
def test_every_member_has_its_own_poles_and_their_box(tmp_path, modes):
    """As the family that is made by hand with the boxes that the effective run file states; the true poles lie inside."""
    path, place = moved(tmp_path, modes=modes, prior={"gain_bound": 0.3, "decay_rate": 1.5})
    found = rid.run(path, tmp_path / "out")
    members = []
    for m in found.run_file.members:
        ((low, high),) = 2 * np.pi * np.array(m.hz_interval)
        assert low < place[m.name] < high
        assert m.damping_interval[0][0] < 0.03 < m.damping_interval[0][1]
        box = 2 * np.pi * np.array(m.hz_interval), np.array(m.damping_interval)
        members.append(rid.guarantee.Member(found.identifications[m.name], m.name, amplitude=m.amplitude, poles=box))
    hand = rid.family(members, omega=found.family.omega, directions=3)
    np.testing.assert_allclose(found.family.upper, hand.upper, rtol=1e-9)
    assert found.family.certified
    poles = [one.problem.parametric.poles for one in found.identifications.values()]
    assert not np.array_equal(*poles)
    again = read_run_file(tmp_path / "out" / "run.toml")
    assert again.members == found.run_file.members
    resumed = rid.run(path, tmp_path / "out", resume=True)
    assert np.array_equal(resumed.family.upper, found.family.upper)


@pytest.mark.usefixtures("unpaged")
@pytest.mark.parametrize("stated", ["", "hz = [1.273]\ndamping = [0.03]\ndelay = 1"])
def test_poles_are_of_the_data_of_each_member_whatever_its_arrays_are_called(tmp_path, stated):
    """A resonance that moves by 4 %: one pole for both contradicts the second member, one for each contradicts neither."""
    lines = []
    for k, (name, at) in enumerate({"weak": 8.0, "strong": 8.3}.items()):
        u = np.random.default_rng(k).standard_normal(200)
        y = np.convolve(u, rid.kautz([at], [0.03], dt=DT, delay=1).impulse(200) @ [0.1, 0.05])[:200]
        y += 1e-3 * np.random.default_rng(k + 2).uniform(-1, 1, 200)
        np.savez(tmp_path / f"{name}.npz", **{f"force_{name}": u, f"angle_{name}": y})
        lines += [
            f'[[members]]\nname = "{name}"\namplitude = {k + 1}\n[[record]]\nfile = "{name}.npz"\nmember = "{name}"'
        ]
        lines += [f'dt = {DT}\nuse = "samples"\nbound = 1e-3\nfields = {{ u = "force_{name}", y = "angle_{name}" }}']
    lines += [
        "[worst_case]\nat_hz = [1.29]\ndirections = 3\n[prior]\ngain_bound = 0.02\ndecay_rate = 1.5\n[modes]",
        stated,
    ]
    (tmp_path / "ask.toml").write_text("\n".join(lines))
    found = rid.run(tmp_path / "ask.toml", tmp_path / "out")
    assert found.consistent is not bool(stated)
    poles = [one.problem.parametric.poles for one in found.identifications.values()]
    assert np.array_equal(*poles) is bool(stated)
    names = {one.problem.outputs[0].name for one in found.identifications.values()}
    assert names == {"angle_weak"}
    if not stated:
        np.testing.assert_allclose([2 * np.pi * m.hz[0] for m in found.run_file.members[1:]], 8.3, rtol=0.003)
        assert rid.run(tmp_path / "out" / "run.toml", tmp_path / "again").run_file.members == found.run_file.members


def test_names_of_arrays_are_no_reason_and_signals_in_another_order_are(tmp_path):
    """Two outputs called otherwise are those of the first member, in order; the same two in another order are refused."""
    frfs = [measured(gain, seed=k) for k, gain in enumerate(GAINS.values())]
    for names, refused in ((("c", "d"), False), (("b", "a"), True)):
        for frf, name, own in zip(frfs, GAINS, (("a", "b"), names), strict=True):
            values = np.concatenate([frf.values, 0.5 * frf.values], axis=1)
            rid.save(tmp_path / f"{name}.npz", rid.FrequencyResponse(LINES, values, bound=0.02, dt=DT, outputs=own))
        path = asked(tmp_path, gains=GAINS, prior={"gain_bound": 6.0, "decay_rate": 2.0})
        path.write_text(path.read_text().replace(".csv", ".npz").replace(f"dt = {DT}", ""))
        if refused:
            with pytest.raises(rid.InputError, match="have different outputs: a, b and b, a"):
                rid.run(path, tmp_path / "refused")
        else:
            found = rid.run(path, tmp_path / "out")
            problems = [one.problem for one in found.identifications.values()]
            assert [[s.name for s in problem.outputs] for problem in problems] == [["a", "b"]] * 2
            assert "c is taken for a, d is taken for b" in found.findings[0]
            assert "c is taken for a" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_faults_of_the_data_of_a_member_stand_on_the_page_with_its_name_and_are_undone(tmp_path):
    wide = {"gain_bound": 20.0, "decay_rate": 1.05}  # it takes the value that is off
    for name, off in (("good", 0.0), ("bad", 0.3)):
        rid.save(tmp_path / f"{name}.csv", rid.prepare.correct(response(off), f"times {1.0 + off}"))
    lines = [
        f'[[members]]\nname = "{name}"\n[[frequency]]\nfile = "{name}.csv"\nmember = "{name}"\n'
        for name in ("good", "bad")
    ]
    (tmp_path / "ask.toml").write_text(
        "".join(lines) + write_toml(CLASS_KEYS | {"prior": wide, "worst_case": {"at_hz": [3.0], "directions": 4}})
    )
    found = rid.run(tmp_path / "ask.toml", tmp_path / "out")
    assert found.consistent
    page = Page((tmp_path / "out" / "report.html").read_text(encoding="utf-8")).text
    assert "Fault of the data member bad undone by" in " ".join(page.split())
    assert "from data with faults" in found.family.summary().splitlines()[0]
    assert found.undoing.paste == 'correct = ["leave out 23"]'
    assert found.undoing.place.endswith("ask.toml, [[frequency]] 2 (bad.csv)")
    text = (tmp_path / "ask.toml").read_text()
    (tmp_path / "ask.toml").write_text(text.replace('file = "bad.csv"', f'file = "bad.csv"\n{found.undoing.paste}'))
    mended = rid.run(tmp_path / "ask.toml", tmp_path / "mended")
    assert mended.undoing is None
    assert "Fault of the data" not in (tmp_path / "mended" / "report.html").read_text(encoding="utf-8")


ONE_MODE = {"hz": [1.3], "damping": [0.03], "delay": 1}


@pytest.mark.usefixtures("unpaged")
def test_a_box_that_modes_states_is_that_of_every_member(tmp_path):
    modes = ONE_MODE | {"hz_interval": [[1.25, 1.34]], "damping_interval": [[0.02, 0.04]]}
    path, _ = moved(tmp_path, modes=modes, prior={"gain_bound": 0.5, "decay_rate": 1.5})
    found = rid.run(path, tmp_path / "out")
    assert [m.hz_interval for m in found.run_file.members] == [((1.25, 1.34),)] * 2


def test_a_box_that_is_too_wide_is_said_and_the_band_is_that_of_the_poles_as_they_are(tmp_path):
    modes = ONE_MODE | {"hz_interval": [[0.1, 2.4]], "damping_interval": [[1e-4, 0.9]]}
    path, _ = moved(tmp_path, points=7, modes=modes, prior={"gain_bound": 10.0, "decay_rate": 1.02})
    found = rid.run(path, tmp_path / "out")
    assert "not for their pole-uncertainty boxes" in found.findings[0]
    assert "prove no bound of the amplitude" in found.findings[0]
    assert np.all(np.isfinite(found.family.upper))


def test_a_member_with_too_few_points_for_the_modes_is_named(tmp_path):
    path, _ = moved(tmp_path, modes={"hz": [1.28, 9.0], "damping": [0.03, 0.01], "delay": 1}, prior=CLASS["prior"])
    rid.save(tmp_path / "weak.csv", rid.FrequencyResponse([5.0, 8.0, 11.0], np.ones(3), bound=1e-3, dt=DT))
    with pytest.raises(rid.InputError, match=r"member 'weak'.*has 3 frequency points; at least 4 are needed"):
        rid.run(path, tmp_path / "out")


def test_a_member_that_refutes_the_class_is_a_finding(tmp_path):
    found = rid.run(asked(tmp_path, {"weak": 0.8, "wild": 30.0}), tmp_path / "out")
    assert found.family is None
    assert not found.consistent
    assert "'wild' (inconsistent, margin" in found.summary()
    assert "inconsistent" in repr(found)
    assert not (tmp_path / "out" / "report.html").exists()


MEMBERS = [{"name": "a"}, {"name": "b"}]
SOURCES = [{"file": "a.csv", "member": "a"}, {"file": "b.csv", "member": "b"}]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"members": MEMBERS[:1], "frequency": SOURCES[:1]}, "one .*members.* makes no family"),
        ({"frequency": [*SOURCES, {"file": "c.csv"}]}, "3 needs member = "),
        ({"frequency": [*SOURCES, {"file": "c.csv", "member": "c"}]}, "member = 'c' is the name of none"),
        ({"members": [*MEMBERS, {"name": "c"}]}, "3: no .*record.* has member = 'c'"),
        ({"members": [*MEMBERS, {"name": "b"}]}, "needs name = ..., one of its own"),
        ({"members": [{"name": "a"}, {"nmae": "b"}]}, "no key 'nmae'; the nearest is 'name'"),
        ({"worst_case": {"compute": False}}, "leaves nothing of a family"),
        ({"members": [{"name": "a", "hz": [1.0]}, {"name": "b"}]}, "1: hz is given without damping"),
        (
            {"members": [{"name": "a", "hz_interval": [[1.0, 2.0]]}, {"name": "b"}]},
            "1: hz_interval has 1 items, hz has",
        ),
        (
            {"members": [*MEMBERS[:1], {"name": "b", "hz": [1.0], "damping": [0.1]}], "modes": {"hz": []}},
            "2: hz has 1 items, that of .modes. 0; the poles may differ",
        ),
        ({"members": []}, "member = 'a' is the name of none"),
    ],
)
def test_contradictions_are_refused(change, words):
    with pytest.raises(rid.InputError, match=words):
        read_run_file({"members": MEMBERS, "frequency": SOURCES} | change)


def test_an_interrupted_family_goes_on_where_it_was(done, tmp_path, monkeypatch):
    """Members whose margin and model are there are not identified again; the folder ends as without the interrupt."""
    path = asked(tmp_path, family={"interval": [0.5, 1.5]})
    calls = []

    def then_interrupted(*arguments, **options):
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return rid.identify(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(sequence, "identify", then_interrupted)
        with pytest.raises(KeyboardInterrupt):
            rid.run(path, tmp_path / "out")
    said = []
    again = rid.run(path, tmp_path / "out", resume=True, progress=lambda text, *_: said.append(text))
    assert "margin and model of weak: taken from the unfinished run" in said
    assert "margin and model of strong: taken from the unfinished run" not in said
    assert np.array_equal(again.family.upper, done[1].family.upper)
    assert not (tmp_path / "out" / "unfinished").exists()
