"""Write blind campaigns: ``python -m tests.rig --out DIR --cases N --seed S``."""

from __future__ import annotations

import argparse
from pathlib import Path

from .campaign import Campaign, make_campaign, write_case

CYCLE = "nsspsnospsnsspsnoscs"
KIND = {"n": "null", "s": "single", "p": "pair", "o": "outside", "c": "confounded"}


def case(number: int, seed: int, far_tracker: bool = False, wide: bool = False) -> Campaign:
    """Return case ``number`` of a set; kinds and effects take turns, so that all occur in a long set."""
    kinds = [KIND[CYCLE[k % len(CYCLE)]] for k in range(number + 1)]
    turn = seed + kinds[:-1].count(kinds[-1])
    return make_campaign(kinds[-1], (seed, number), far_tracker=far_tracker, turn=turn, wide=wide)


def main(argv: list[str] | None = None) -> None:
    """Write the cases that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m tests.rig", description="Write blind measurement campaigns.")
    parser.add_argument("--out", type=Path, required=True, help="folder for case_000, case_001, …")
    parser.add_argument("--cases", type=int, default=60, help="how many (60)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the set (0)")
    parser.add_argument("--far-tracker", action="store_true", help="let the tracker stand metres away and turned")
    parser.add_argument(
        "--wide", action="store_true", help="rows, noise and workmanship as they vary from shop to shop"
    )
    options = parser.parse_args(argv)
    for number in range(options.cases):
        campaign = case(number, options.seed, options.far_tracker, options.wide)
        folder = write_case(options.out / f"case_{number:03d}", campaign)
        hidden = ", ".join(f"{e['effect']}/{e['form']} {e['ratio_to_noise']:.1f}" for e in campaign.truth["effects"])
        print(f"{folder}: {campaign.truth['kind']} {hidden}")


if __name__ == "__main__":
    main()
