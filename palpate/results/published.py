"""The paper's numbers, typed from its tables; each row says which.

| file | key columns | unit |
|---|---|---|
| model_selection | experiment, class | m^2 x 9000 |
| input_modalities | experiment, class | m^2 x 9000 |
| local_touch_charts | class | m^2 x 9000 |
| grasps | experiment (setup, grasps) | m^2 x 9000 |
| extrapolation | experiment (setup), ring | m^2, one-directional |
| single_image | method | Pixel2Mesh's protocol: thousandths, and percent |
"""

import csv
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path(__file__).parent / "paper"


# The tables whose rows are experiments of config/experiments.yaml; claims compare nothing else.
OF_EXPERIMENTS = ("model_selection", "input_modalities", "grasps", "extrapolation")


def published_experiments(*tables: str) -> list[str]:
    """The experiments that the paper has numbers of in these tables (if none: `OF_EXPERIMENTS`)."""
    found: dict[str, None] = {}
    for table in tables or OF_EXPERIMENTS:
        with open(FOLDER / f"{table}.csv", newline="", encoding="utf-8") as file:
            found |= dict.fromkeys(row["experiment"] for row in csv.DictReader(file))
    return list(found)


def paper_values(table: str) -> "pd.DataFrame":
    """The paper's numbers for a table, in its order; FileNotFoundError for a table it does not have."""
    import pandas  # not for those who only plan

    path = FOLDER / f"{table}.csv"
    if not path.exists():
        known = sorted(file.stem for file in FOLDER.glob("*.csv"))
        raise FileNotFoundError(f"{path}: the paper has numbers for the tables {known}, not for {table!r}")
    return pandas.read_csv(path)
