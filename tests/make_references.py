"""Make the reference logs of `calstation validate` and their answers again: make references.

The logs are simulated with fixed seeds. Their samples are part of the release, so that a computer solves the same
samples as every other; the answers are those of the computer that made the release.
"""

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import tomli_w

from calstation.config import library
from calstation.records import export_csv, write_log
from calstation.schema import read_toml
from calstation.simulation import make_recording, simulate_log
from calstation.validation import ANSWERS, answer_of

QUICK = {"rate_dps": 200.0, "acceleration_dps2": 300.0}
#: Shortest schedule of the default stages.
SHORT: dict[str, Any] = {
    "rate": {"turns": 1, "dwell_s": 2.0, **QUICK},
    "six_position": {"dwell_s": 2.0, "oblique_dwell_s": 2.0, **QUICK},
    "excitation": {"dwell_s": 2.0, "place_dwell_s": 1.0, "rounds": 1, **QUICK},
    "azimuth_flip": {"dwell_s": 4.0, "rounds": 1, **QUICK},
}
#: Recordings without a table, by the name of the method that solves them.
WITHOUT_TABLE = {"multi_position": "hand", "cross_calibration": "pair", "gimbal": "gimbal"}
#: Logs that `calstation verify` covers.
COVERED = ("four_stages", "designed")


def main(target: Path) -> None:
    """Write the logs as CSV with their configuration, and their answers, to a folder."""
    target.mkdir(parents=True, exist_ok=True)
    answers = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        product = read_toml(library.shipped_folder() / "products" / "mems_c.toml") | {"schedule": SHORT}
        product.pop("checks")  # they need the whole schedule
        product["limits"] = {name: {"within": limit["within"]} for name, limit in product["limits"].items()}
        (folder / "four_stages.toml").write_text(tomli_w.dumps(product), encoding="utf-8")
        products = {"four_stages": folder / "four_stages.toml", "designed": library.find("products", "mems_c_fast")}
        for name in (*products, *WITHOUT_TABLE):
            raw = folder / f"{name}.h5"
            if name in products:
                simulated, truth = simulate_log(lambda *_, **__: None, None, products[name], 1)
                write_log(raw, simulated.meta, simulated.blocks())
            else:
                _, truth = make_recording(WITHOUT_TABLE[name], raw, "mems", 1)  # type: ignore[arg-type]
            export_csv(raw, target / f"{name}.csv.gz")
            answers[name] = answer_of(target / f"{name}.csv.gz", truth) | {"second_opinion": name in COVERED}
    text = json.dumps(answers, indent=1) + "\n"
    (target / ANSWERS).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else library.shipped_folder() / "references")
