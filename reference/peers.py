"""The same work by this project's Python package and by other programs, in one run, as a page of Markdown.

    reference/python reference/peers.py [SAMPLES [REPETITIONS]]

Simulation: one motion through one model; fitting: one model to one recording. The programs take turns on one core; printed
are medians, and errors beside them. README.md says what each time includes, docs/explanation/peers.md carries the output.
"""

import importlib.metadata
import os
import statistics
import sys
import time

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[threads] = "1"  # Before the libraries are loaded.

import numpy  # noqa: E402

import peers_fit  # noqa: E402
import peers_simulate  # noqa: E402

PACKAGES = ("numpy", "scipy", "numba", "mujoco", "openseespy", "lmfit")


def median_of_turns(programs, repetitions):
    """name -> (median seconds of processor time, last result); every program once per turn."""
    seconds, results = {name: [] for name in programs}, {}
    for _ in range(repetitions):
        for name, program in programs.items():
            spent, results[name] = program()
            seconds[name].append(spent)
    return {name: (statistics.median(all_of_one), results[name]) for name, all_of_one in seconds.items()}


def table(head, rows):
    print(f"\n| {' | '.join(head)} |\n|{' --- |' * len(head)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def simulation(samples, repetitions):
    print(f"\n## Simulation: {samples} samples at 1 kHz, ns per sample\n")
    print(f"Median of {repetitions} turns, one core. Errors are the largest against the exact solution in 80-bit numbers.")
    for title, programs, exact in peers_simulate.cases(samples):
        found = median_of_turns({name: program for name, (program, _) in programs.items()}, repetitions)
        ours = next(iter(found.values()))[0]
        rows = []
        for name, (nanoseconds, forces) in found.items():
            reference = exact[programs[name][1]]
            count = min(reference.size, forces.size)
            error = numpy.max(numpy.abs(forces[:count] - reference[:count]))
            rows.append((name, f"{nanoseconds:.1f}", f"{nanoseconds / ours:.2f}", f"{error:.0e} N"))
        print(f"\n### {title}")
        table(("program", "ns per sample", "times trocar", "largest error"), rows)


def fitting(repetitions):
    print(f"\n## Fitting: {peers_fit.SAMPLES} samples at 1 kHz, noise of {peers_fit.NOISE_N} N\n")
    print(f"Processor time of one core, median of {repetitions} turns, of trocar a single one. Errors of parameters in parts of the truth.")
    for title, programs, judge in peers_fit.cases():
        found = median_of_turns(programs, repetitions)
        ours = found["trocar"][0]
        rows = []
        for name, (seconds, numbers) in found.items():
            rms, worst = judge(numbers)
            rows.append((name, f"{seconds:.3f}", f"{seconds / ours:.2f}", f"{1e3 * rms:.4f} mN", f"{worst:.1e}"))
        print(f"\n### {title}")
        table(("program", "s", "times trocar", "rms of the residual", "worst parameter"), rows)


def main():
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 7
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    print(f"trocar {importlib.metadata.version('trocar')} beside {versions}; Python {sys.version.split()[0]}.")
    simulation(samples, repetitions)
    fitting(min(repetitions, 5))


if __name__ == "__main__":
    main()
