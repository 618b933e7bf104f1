"""Copy the committed Minari dataset with the five fields that Minari asks for, ready to upload.

python release/minari.py OWNER EMAIL out/minari
MINARI_DATASETS_PATH=out/minari minari upload aquafish/damaged-v0 --key-path KEY

OWNER is the owner of the repository on GitHub, EMAIL an address to ask.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATASET = "aquafish/damaged-v0"
PROGRAM = "examples/minari_dataset.py"


def copy_dataset(owner: str, email: str, out: Path) -> None:
    """Copy the dataset to a new folder and write its fields."""
    shutil.copytree(ROOT / "docs" / "results" / "minari", out)
    os.environ["MINARI_DATASETS_PATH"] = str(out.resolve())
    import minari

    log = ["git", "-C", str(ROOT), "log", "-1", "--format=%H", "--", "docs/results/minari"]
    commit = subprocess.run(log, capture_output=True, text=True, check=True).stdout.strip()
    minari.load_dataset(DATASET).storage.update_metadata(
        {
            "author": {"The AquaFish authors"},
            "author_email": {email},
            "code_permalink": f"https://github.com/{owner}/aquafish/blob/{commit}/{PROGRAM}",
            "algorithm_name": "CMA-ES (aquafish evolve), actions with noise of 0.1",
            "description": (
                "A robot fish swims forward for 20 s. Between 2 and 10 s a fin, a servo or a "
                "sensor breaks, as drawn from the tier severe; info has the truth."
            ),
        }
    )


if __name__ == "__main__":
    copy_dataset(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
