"""The command and its server: who is answered, what can not be explored, records that are opened directly, Ctrl-C."""

import dataclasses
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest

import robustid as rid
from robustid.app.explore.views import View, views
from robustid.core import Interruptible
from robustid.errors import InputError
from support.explored import run_file, served, session, until
from support.interrupts import ctrl_c

pytest.importorskip("dash")


def answer(address, **headers):
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(urllib.request.Request(address, headers=headers), timeout=10) as found:
            return found.status, found.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_only_who_has_the_token_is_answered_and_only_under_the_address(tmp_path):
    def never(_):
        raise AssertionError

    explored = session(tmp_path)
    views = [View("one", lambda _: explored), View("other", never)]
    with served(explored, views) as server:
        site, token = server.address.split("/?token=")
        port = site.rsplit(":", 1)[1]
        cookie = f"robustid-{port}={token}"
        for path in ("/", "/_dash-layout", "/_dash-update-component", "/assets/page.js", "/1/"):
            code, words = answer(site + path)
            assert code == 403
            assert words.startswith("This page belongs to whoever started robustid explore")
        assert answer(f"{site}/?token=guessed")[0] == 403
        assert answer(f"{site}/", Cookie=cookie)[0] == 200
        assert answer(f"{site}/", Cookie=cookie, Origin="http://elsewhere.example")[0] == 403
        code, words = answer(server.address, Host="elsewhere.example")
        assert (code, f"requests to 127.0.0.1:{port} only" in words) == (403, True)
        assert answer(server.address)[1].startswith("This page")  # the cookie is for a browser, and this one keeps none


def test_another_page_opens_when_it_is_asked_for_and_says_why_it_can_not(tmp_path):
    explored = session(tmp_path)

    def refused(progress):
        progress("looking <around>", 3, 9)
        raise InputError("`file` is no response & never was")

    views = [View(name, open) for name, open in zip("abc", (None, lambda _: explored, refused), strict=True)]
    with served(explored, views) as server:
        site, token = server.address.split("/?token=")
        headers = {"Cookie": f"robustid-{site.rsplit(':', 1)[1]}={token}"}
        found = answer(f"{site}/1/", **headers)[1]
        assert '<p role="status">Choosing what is not stated …</p>' in found
        until(lambda: "window.explored" in answer(f"{site}/1/", **headers)[1])
        assert "Test plant: b" in answer(f"{site}/1/", **headers)[1]
        assert answer(f"{site}/1/_dash-layout", **headers)[0] == 200
        until(lambda: "file is no response &amp; never was" in answer(f"{site}/2/", **headers)[1])
        assert 'http-equiv="refresh"' not in answer(f"{site}/2/", **headers)[1]
        assert answer(f"{site}/2/assets/page.js", **headers)[0] == 404


def test_a_record_is_opened_by_the_response_that_is_estimated_from_it(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    period, rng = 40, np.random.default_rng(0)
    u = np.tile(rng.standard_normal(period), 12)
    y = np.convolve(u, [0.0, 1.0, 0.5])[: u.size] + 1e-3 * rng.standard_normal(u.size)
    rid.save("record.csv", rid.TimeRecord(u, y, dt=0.01))
    seen = []
    monkeypatch.setattr("robustid.app.explore.server.serve", lambda *given: seen.append(given))
    code, _, err = run(["explore", "record.csv", "--period", str(period), "--band", "2:40"])
    assert code == 0, err
    found, title, *_, views = seen[0]
    assert (title, len(views)) == ("record.csv", 1)
    points = found.points_hz
    assert (points.min(), points.max()) == (2.5, 40.0)
    assert found.data.responses[0].values[0, 0, 0] == pytest.approx(
        np.exp(-2j * np.pi * 0.025) + 0.5 * np.exp(-4j * np.pi * 0.025), abs=1e-2
    )
    (source,) = found.written(found.start).record
    assert (source.file, source.use, found.run.estimate.period) == ("record.csv", "response", period)


def test_what_can_not_be_explored_is_said_in_one_sentence(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ask = run_file(tmp_path).name
    data = rid.load("frf.csv")
    rid.save(
        "matrix.npz",
        dataclasses.replace(data, values=np.tile(data.values, (1, 2, 2)), bound=0.03, inputs=None, outputs=None),
    )
    (tmp_path / "broken.csv").write_text("omega,real\nfour,five\n")
    (tmp_path / "passive.toml").write_text(
        '[[frequency]]\nfile = "frf.csv"\n[prior]\npassive = "positive real"\ndecay = 1.0\n'
    )
    (tmp_path / "still.csv").write_text("t,u,y\n" + "".join(f"{k},0,{k % 3}\n" for k in range(200)))
    (tmp_path / "short.csv").write_text("t,u,y\n0,1,0\n0.1,0,1\n0.2,1,2\n0.3,1,1\n")
    (tmp_path / "samples.toml").write_text('[[record]]\nfile = "step.csv"\nuse = "samples"\n')
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for arguments, sentence in (
            (["nothing.csv"], "nothing.csv: there is no such file"),
            (["broken.csv"], "broken.csv"),
            (["still.csv"], "input u is constant (0): it excites nothing"),
            (["short.csv"], "FILE has 4 samples"),
            (["frf.csv", "matrix.npz"], "several files are time records of one plant"),
            ([ask, "frf.csv"], "give it alone"),
            (["matrix.npz", "--entry", "2,0"], "--entry 2,0"),
            (["passive.toml"], "passive class"),
            (["samples.toml"], "needs a frequency response"),
            ([ask, "--dt", "0.01"], "says itself how its data are read"),
            (["--dt", "0.01"], "without a FILE"),
            ([ask, "--port", port, "--no-browser"], f"port {port} can't be used"),
        ):
            code, _, err = run(["explore", *arguments])
            assert (code, sentence in " ".join(err.split())) == (2, True), (arguments, err)


def test_the_command_says_the_address_and_ends_with_ctrl_c(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_file(tmp_path)
    opened = []

    def kept_back(*asked):
        with Interruptible():  # a loop that has something to return
            raise KeyboardInterrupt
        return views(*asked)

    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)))  # there is no browser
    monkeypatch.setattr("robustid.app.explore.server.Server.serve", ctrl_c)
    options = ["--frequency-bound", "0.03", "--dt", "0.01"]
    for arguments in (["ask.toml"], ["frf.csv", *options]):
        code, out, _ = run(["explore", *arguments])
        assert code == 0
        assert f"the page: {opened[-1]}" in out
        assert "no browser was found: open that address" in out
        assert out.endswith("closed\n")
    with monkeypatch.context() as kept:
        kept.setattr("robustid.app.explore.views.views", kept_back)
        assert run(["explore", "ask.toml"])[0] == 130
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "dash", None)
        code, _, err = run(["explore", "ask.toml"])
    assert (code, "pip install 'robustid[explore]'" in " ".join(err.split())) == (2, True)


@pytest.mark.slow
def test_ctrl_c_ends_the_program_while_it_computes(tmp_path):
    command = [sys.executable, "-m", "robustid", "explore", "--no-browser"]  # the data of the demo
    with (
        (tmp_path / "stderr.txt").open("w") as said,  # of a busy machine it holds that the program is ending
        subprocess.Popen(
            command,
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            # tests in the background of a shell ignore Ctrl-C, and so would the program
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        ) as program,
    ):
        lines = iter(program.stdout.readline, "")
        site, token = (
            next(line for line in lines if "the page: " in line).split("the page: ")[1].strip().split("/?token=")
        )
        port = site.rsplit(":", 1)[1]
        assert answer(f"{site}/", Cookie=f"robustid-{port}={token}")[0] == 200
        program.send_signal(signal.SIGINT)
        assert program.stdout.read().endswith("closed\n")
    assert program.returncode == 0
    assert "Traceback" not in (tmp_path / "stderr.txt").read_text()
    assert (tmp_path / "robustid-demo" / "step.csv").exists()
