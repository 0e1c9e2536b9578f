"""How honest and how quick the choice of methods is: random jobs against the fastest method that would have done."""

from __future__ import annotations

from statistics import median

import roslf_design as roslf
from roslf_design.commands.accuracy import study

JOBS = 108


def main() -> None:
    trials = study("promises").try_choice(roslf.load("paper"), JOBS, seed=1)
    kept = sum(trial.kept for trial in trials)
    print(f"{kept} of {len(trials)} random jobs at accuracies 1e-1 to 1e-9 within what was promised")
    print(f"{'quantity':20s} {'kept':>9s} {'worst/promise':>14s} {'time':>10s} {'over fastest':>13s}")
    for quantity in dict.fromkeys(trial.job.quantity for trial in trials):
        mine = [trial for trial in trials if trial.job.quantity == quantity]
        ratios = [trial.slowdown for trial in mine if trial.slowdown is not None]
        worst = max(trial.actual_error / trial.accuracy for trial in mine)
        seconds = median(trial.answer.seconds for trial in mine)
        held = f"{sum(trial.kept for trial in mine)} of {len(mine)}"
        print(f"{quantity:20s} {held:>9s} {worst:14.2g} {1e6 * seconds:7.0f} us {median(ratios):13.2f}")
    slow = [trial.slowdown for trial in trials if trial.slowdown is not None]
    print(f"median time over that of the fastest that would have kept the promise: {median(slow):.2f}")


if __name__ == "__main__":
    main()
