"""Write blind campaigns: `python -m tests.examiner --out DIR --cases N --seed S`."""

import argparse
from pathlib import Path

import numpy as np

from tests.examiner import cases


def main(argv=None):
    """Write the campaigns; each case hangs on seed and number alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, required=True)
    args = parser.parse_args(argv)
    for number, (kind, index) in enumerate(cases.plan(args.cases, args.seed)):
        try:
            case = cases.make(args.seed, number, kind, index)
        except cases.NoCaseError as problem:
            print(f"left out: {problem}", flush=True)
            continue
        cases.write(case, args.out / f"case_{number:03d}", np.random.default_rng([args.seed, number, 10**6]))
        names = " + ".join(f"{e['effect']} ({e['form']}) {e['ratio_to_noise']:.1f}" for e in case.truth["effects"])
        print(f"case_{number:03d} {kind:10s} {names}", flush=True)


if __name__ == "__main__":
    main()
