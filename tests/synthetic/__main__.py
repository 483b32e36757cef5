"""Make synthetic data: `python tests/synthetic history|logs|golden --help`."""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the workers too, which import `synthetic`

from calstation.estimation.positions import TABLE_QUANTITIES
from synthetic.golden import golden_demo
from synthetic.many_logs import record_logs
from synthetic.run_history import synthesise_runs


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python tests/synthetic", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    history = commands.add_parser("history", help="results of a year of runs, and a gauge study")
    history.add_argument("--runs", type=int, default=2000)
    logs = commands.add_parser("logs", help="short raw logs of three stations with all 30 parameters each")
    logs.add_argument("--count", type=int, default=300)
    logs.add_argument("--grade", choices=("nav", "tactical", "mems"), default="mems")
    for command in (history, logs):
        command.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    golden = commands.add_parser("golden", help="charts of the table before and after a shift of an axis")
    golden.add_argument("--runs", type=int, default=370, help="golden runs without a shift")
    golden.add_argument("--shift", type=float, default=1.0, help="in standard deviations from run to run")
    golden.add_argument("--quantity", choices=TABLE_QUANTITIES, default="orthogonality")
    golden.add_argument("--production", type=int, default=4, help="runs of production before each golden run")
    for command in (history, logs, golden):
        command.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


def show(fraction: float, *_: object, **__: object) -> None:
    sys.stderr.write(f"\r{100 * fraction:.0f} %")


def main() -> None:
    args = parse()
    if args.command == "golden":
        found = golden_demo(
            args.runs, args.shift, args.seed, args.quantity, args.production, lambda done, count: show(done / count)
        )
        print(json.dumps(found, indent=1))
    elif args.out.is_dir() and any(args.out.iterdir()):
        sys.exit(f"{args.out} is not empty: choose another folder")
    elif args.command == "history":
        print(synthesise_runs(show, args.out, args.runs, args.seed))
    else:
        record_logs(show, args.out, args.count, args.grade, args.seed)


if __name__ == "__main__":
    main()
