"""Every command on a problem of several seconds: the longest silence between two lines, and how long Ctrl-C takes to end it.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/interruptions.py [COMMAND ...] [--folder FOLDER]
Bars: 3 s between two lines, .5 s until a command has ended or has said that it is ending, exit code 130. On a busy machine the
processor time after Ctrl-C says more than the wall clock. What is prepared in FOLDER is used again.
"""

import argparse
import itertools
import os
import pathlib
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time

import control
import numpy as np
from band_problems import mirror_response, motor_halves

import robustid as rid

MOMENTS = (
    1.0,
    0.4,
    0.7,
    0.9,
)  # first: seconds, while libraries are imported; then shares of the time of the whole command
LONGEST = 25.0  # seconds of a command, which is interrupted then
CASES = {  # each is long by what it is given; {data}: the measurements
    "demo": "demo",
    "look": "look {data}/beam_ring/asymexc_1.mat response.npz large.npz {data}/fsm_cubespec/y_300mV_train.npy",
    "identify": "identify --frequency mirror.npz --entry 1,1 --report page.html -o found",
    "new": "new response.npz records.npz -o new.toml",
    "run": "run bench.toml -o bench",
    "excite": "excite --band 1:4000 --dt 1e-4 --period 40000 --inputs 3 --realisations 6",
    "frf": "frf records.npz --method local -o local.npz",
    "fit": "fit mirror.npz --order 60 -o fit.npz",
    "fit auto": "fit mirror.npz --order auto -o auto.npz",
    "bounds": "bounds result --points 300 --circle",
    "bounds workers": "bounds result --points 300 --workers 2 -o workers --resume unfinished",
    "reduce": "reduce result -o smaller.npz",
    "reduce model": "reduce large.npz --order 40 -o small.npz",
    "compare": "compare response.npz halves.npz -o compared",
    "verify": "verify bounded --exact",
    "refute": "refute result --frequency halves.npz",
    "watch": "watch band halves.npz response.npz -o watched",
    "report": "report result --sensitivity -o page.html",
    "export": "export large.npz -o exported.json",
    "loop": "loop result --controller gain.npz",
    "connect": "connect band gain.npz --time-limit 60",
    "control": 'control band --structure "PID(80), Notch(30..40)" --peak 2',
    "explore": "explore response.npz --no-browser",
}


def prepared(folder):
    """Make the files that the commands take, once."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, dt = np.random.default_rng(0), 4e-4
    if (folder / "gain.npz").exists():
        return
    first, second = motor_halves()
    rid.save(folder / "response.npz", first)
    rid.save(folder / "halves.npz", second)
    rid.save(folder / "mirror.npz", mirror_response())
    found = rid.identify_reduced(first).identification
    found.save(folder / "result")
    rid.band(found).save(folder / "band")
    rid.worst_case_error(found).save(folder / "bounded")
    for name in ("records", "records2"):
        u = rng.normal(size=(200000, 2))
        rid.save(
            folder / f"{name}.npz", rid.TimeRecord(u, np.cumsum(u, axis=0) % 1.0 + rng.normal(size=u.shape), dt=dt)
        )
    n = 1200
    omega = 2 * np.pi * np.geomspace(1, 1000, n // 2)
    a = np.zeros((n, n))
    for k, one in enumerate(omega):
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-0.01 * one, one], [-one, -0.01 * one]]
    rid.save(folder / "large.npz", control.ss(a, rng.normal(size=(n, 2)), rng.normal(size=(2, n)), 0))
    (folder / "bench.toml").write_text('[[frequency]]\nfile = "response.npz"\n')
    rid.save(folder / "gain.npz", control.ss([], [], [], 1e-4, dt))


class Program:
    """A command in a folder of its own, with the times of its lines."""

    def __init__(self, words, files, folder):
        folder.mkdir()
        for file in files.iterdir():
            (folder / file.name).symlink_to(file)
        self.given, self.folder, self.lines = set(os.listdir(folder)), folder, []
        self.began = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "robustid", *words],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append((time.monotonic() - self.began, line.rstrip()))

    def over(self, seconds):
        """Wait at most so long; True if it has ended."""
        try:
            self.process.wait(max(seconds - (time.monotonic() - self.began), 0))
        except subprocess.TimeoutExpired:
            return False
        return True

    def processor(self):
        """Processor time of all its processes so far."""
        ticks = sum(sum(map(int, fields[11:13])) for fields in self._processes().values())
        return ticks / os.sysconf("SC_CLK_TCK")

    def _processes(self):
        """Fields of /proc/PID/stat, after the name, of the processes of its session."""
        found = {}
        for place in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                fields = (place / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == self.process.pid and fields[0] != "Z":
                found[place.name] = fields
        return found

    def interrupted(self):
        """Ctrl-C as of a terminal; seconds to its first word and its end, processor time, exit code, processes left."""
        before, at = self.processor(), time.monotonic() - self.began
        os.killpg(self.process.pid, signal.SIGINT)
        usage = os.wait4(self.process.pid, 0)
        self.process.returncode = os.waitstatus_to_exitcode(usage[1])
        ended = time.monotonic() - self.began - at
        self._reader.join(2)
        word = next((when - at for when, _ in self.lines if when > at), ended)
        spent = usage[2].ru_utime + usage[2].ru_stime - before
        time.sleep(0.2)
        left = len(self._processes())
        return at, min(word, ended), ended, spent, self.process.returncode, left

    @property
    def silence(self):
        """The longest time without a line, and the line before."""
        times = [(0.0, "start"), *self.lines, (time.monotonic() - self.began, "")]
        return max((later - one, line) for (one, line), (later, _) in itertools.pairwise(times))

    @property
    def made(self):
        """Files that it has made, and of those that can be opened the number."""
        return sorted(set(os.listdir(self.folder)) - self.given)


def measured(name, files, place):
    """Rows of a command: one of the whole, one for every moment of Ctrl-C."""
    data = os.environ["ROBUSTID_DATA"]
    words = [word.format(data=data) for word in shlex.split(CASES[name])]
    whole = Program(words, files, place / "whole")
    ended = whole.over(LONGEST)
    silence, line = whole.silence
    length = time.monotonic() - whole.began
    last = None if ended else whole.interrupted()
    code = whole.process.returncode
    more = "" if ended else " and more"
    print(
        f"{name:15} {length:5.1f} s{more}, exit code {code}; longest silence {silence:4.1f} s after: {line[:60]}",
        flush=True,
    )
    rows = [] if last is None else [(*last, whole)]
    for k, share in enumerate(MOMENTS):
        program = Program(words, files, place / str(k))
        if program.over(share if not k else share * length):
            print(f"  at {share}: over before")
            continue
        rows.append((*program.interrupted(), program))
    for at, word, end, spent, code, left, program in rows:
        tail = " | ".join(line for when, line in program.lines if when >= at - 0.01)[:110]
        held = "held" if word <= 0.5 and code in (130, 0) and not left else "NOT HELD"
        words = f"word {word:.2f} s, end {end:.2f} s, processor {spent:.2f} s, exit code {code}, processes left {left}, {held}"
        print(f"  Ctrl-C at {at:4.1f} s: {words}; made {', '.join(program.made[:6]) or 'nothing'}; {tail}", flush=True)
    return silence, rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--folder", type=pathlib.Path, default=pathlib.Path(tempfile.gettempdir()) / "interruptions")
    asked = parser.parse_args()
    files = asked.folder.resolve() / "files"
    prepared(files)
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name in asked.names or CASES:
        with tempfile.TemporaryDirectory() as place:
            measured(name, files, pathlib.Path(place))


if __name__ == "__main__":
    main()
