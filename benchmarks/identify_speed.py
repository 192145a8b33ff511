"""How fast a record is identified: the Allan deviation against other programs, a whole fit, and a long file.

Usage: python benchmarks/identify_speed.py [allan | fit | memory [SAMPLES]]

Times are the minimum of several repeats in this process, on fresh random data whose seed is printed; what the
compiled kernel costs once (import, compilation or reading it back) is measured in processes of its own and
printed separately. Without an argument: all three, the file with 1e8 samples.
"""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.signal import lfilter

from kfgen.identify.evidence import differences
from kfgen.identify.evidence.allan import log_factors, overlapping_variance
from kfgen.identify.evidence.long import Stream, condense
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.choice import combined
from kfgen.identify.identify import identify
from kfgen.identify.methods.likelihood import best_of, by_likelihood
from kfgen.log.readers import ColumnMap, read_long
from kfgen.log.readers.tables.table import chunks

Values = np.ndarray
REPEATS = 5
FULL = ("white_noise", "gauss_markov", "rate_random_walk")
COLD = """
import time, sys
import numpy as np
from kfgen.identify.evidence import running_allan as phase
start = time.perf_counter()
import numba
imported = time.perf_counter()
phase.kernel(float("inf"))
print(imported - start, time.perf_counter() - imported)
"""


def load() -> str:
    """What else the machine is doing."""
    return f"{os.cpu_count()} processors, load {' '.join(f'{v:.2f}' for v in os.getloadavg())}"


def fastest(work: Callable[[], Values], repeats: int = REPEATS) -> tuple[float, Values]:
    """Minimum of the seconds, and the result."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - start)
    return best, result


def programs(y: Values, m: Values) -> dict[str, Callable[[], Values]]:
    """The Allan variance of `y` at the same factors by each program that is installed."""

    def kfgen(compiled: bool) -> Callable[[], Values]:
        def work() -> Values:
            with patch.object(differences, "MIN_SAMPLES_FOR_COMPILED", 0 if compiled else float("inf")):
                return overlapping_variance(y, m)

        return work

    found: dict[str, Callable[[], Values]] = {}
    if find_spec("allantools"):
        import allantools

        found["allantools.oadev"] = lambda: (
            allantools.oadev(y, rate=1.0, data_type="freq", taus=m.astype(float))[1] ** 2
        )
    if find_spec("allan_variance"):
        import allan_variance.avar as nmayorov

        def other() -> Values:  # it chooses its own factors; only their list is replaced
            with patch.object(nmayorov, "_compute_cluster_sizes", lambda *_: m):
                return nmayorov.compute_avar(y, dt=1.0, input_type="mean")[1]

        found["allan_variance.compute_avar"] = other
    found["kfgen, numpy"] = kfgen(False)
    if find_spec("numba"):
        found["kfgen, numba"] = kfgen(True)
    return found


def side_by_side() -> None:
    """The overlapping Allan deviation, program by program."""
    for n in (1_000_000, 10_000_000):
        seed = secrets.randbits(32)
        y = np.random.default_rng(seed).standard_normal(n)
        m = log_factors(n, 18 if n < 2_000_000 else 15)  # about 90
        print(
            f"\nAllan deviation of {n:.0e} samples at {m.size} factors up to {m[-1]}; seed {seed}; {load()}"
        )
        print(
            f"  {'':30} {'s':>8} {'times kfgen, numpy':>20} {'difference m < 128':>20} {'m < n/50':>10} {'all':>10}"
        )
        results = {
            name: fastest(work, 3 if "kfgen" not in name else 7) for name, work in programs(y, m).items()
        }
        reference, unit = next(iter(results.values()))[1], results["kfgen, numpy"][0]
        for name, (seconds, avar) in results.items():
            off = np.abs(np.sqrt(avar / reference) - 1.0)
            worst = [off[m < 128].max(), off[m < n / 50].max(), off.max()]
            print(
                f"  {name:30} {seconds:8.3f} {seconds / unit:20.2f} {worst[0]:20.1e} {worst[1]:10.1e} {worst[2]:10.1e}"
            )
    print(
        "  Differences are relative, of the standard deviation, to the first program; from m = 128 on kfgen thins records beyond\n"
        "  2e6 samples. compute_avar leaves one difference out: its phase lacks the zero it starts from."
    )
    if find_spec("numba"):
        once()


def once() -> None:
    """What the compiled kernel costs a process: for the first time on a machine, and from then on."""
    with tempfile.TemporaryDirectory() as folder:
        for what in ("compiling", "reading the compiled code"):
            done = subprocess.run(
                [sys.executable, "-c", COLD],
                env={**os.environ, "NUMBA_CACHE_DIR": folder},
                capture_output=True,
                text=True,
                check=True,
            )
            imported, kernel = map(float, done.stdout.split())
            print(f"  once a process: importing numba {imported:.3f} s, {what} {kernel:.3f} s")


def full_fit() -> None:
    """A whole identification of one channel: white noise, a Gauss-Markov bias and a random walk."""
    seed, n, rate = secrets.randbits(32), 10_000_000, 100.0
    rng, e = np.random.default_rng(seed), np.exp(-1 / (100.0 * rate))
    y = rng.standard_normal(n) * 5.75e-2 * np.sqrt(rate)
    y += lfilter([1.0], [1.0, -e], rng.standard_normal(n) * 1.55e-2 * np.sqrt(1 - e * e))
    y += np.cumsum(rng.standard_normal(n)) * 9e-4 / np.sqrt(rate)
    record = Record(np.arange(n) / rate, y)
    stream = Stream.of(y, 1.0 / rate)
    long = condense(stream)

    def timed(work: Callable[[], object]) -> float:
        return fastest(lambda: np.array([work() is None]), 3)[0]

    print(f"\nIdentification of {n:.0e} samples; seed {seed}; {load()}")
    rows = {
        "one pass: Allan variance, block means, outliers": lambda: condense(stream),
        "fit of N, sigma, tau, K to them": lambda: best_of(long, combined(long, FULL)),
        "the same with profile intervals": lambda: by_likelihood(long, FULL),
        "choice of terms, intervals, limits": lambda: by_likelihood(long, None),
        "everything": lambda: identify(record),
    }
    for name, work in rows.items():
        print(f"  {name:50} {timed(work):6.2f} s")
    print(f"  {', '.join(map(str, identify(record).fit.effects))}")


def memory(n: int) -> None:
    """A float32 file, identified from its chunks by a process of its own: three tenths of it, then all."""
    seed = secrets.randbits(32)
    rng = np.random.default_rng(seed)
    print(f"\nIdentification of a float32 .npy in chunks; seed {seed}; {load()}")
    print(
        f"  {'samples':>10} {'file':>10} {'s':>8} {'ns a sample':>12} {'peak, MB':>10} {'before, MB':>11} {'factors':>8}"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.npy"
        for size in (3 * n // 10, n):
            array = np.lib.format.open_memmap(path, "w+", np.float32, (size,))
            for part in chunks(array):
                part[:] = rng.standard_normal(part.size, dtype=np.float32)
            array.flush()
            del array
            done = subprocess.run(
                [sys.executable, __file__, "child", str(path)], capture_output=True, text=True, check=True
            )
            seconds, peak, before, factors = map(float, done.stdout.split())
            print(
                f"  {size:10.0e} {path.stat().st_size / 1e6:7.0f} MB {seconds:8.2f} {1e9 * seconds / size:12.1f} "
                f"{peak:10.0f} {before:11.0f} {factors:8.0f}"
            )
            path.unlink()


def child(path: str) -> None:
    """Seconds, peak memory [MB] after and before, number of averaging factors."""
    from resource import RUSAGE_SELF, getrusage

    before = getrusage(RUSAGE_SELF).ru_maxrss / 1e3
    start = time.perf_counter()
    log = read_long(path, rate=100.0, columns=ColumnMap.parse("gyro_x=#1 [rad/s]"))
    channel = log.channel("gyro_x")
    found = identify(condense(Stream(channel.chunks, channel.n, log.dt)))
    seconds = time.perf_counter() - start
    print(seconds, getrusage(RUSAGE_SELF).ru_maxrss / 1e3, before, found.record.curve.tau.size)


def main() -> None:
    """Run what the command line names."""
    what, *rest = sys.argv[1:] or ["all"]
    if what == "child":
        child(rest[0])
    if what in ("allan", "all"):
        side_by_side()
    if what in ("fit", "all"):
        full_fit()
    if what in ("memory", "all"):
        memory(int(float(rest[0])) if rest else 100_000_000)


if __name__ == "__main__":
    main()
