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

from pathlib import Path

import pandas as pd

FOLDER = Path(__file__).parent / "paper"


def paper_values(table: str) -> pd.DataFrame:
    """The paper's numbers for a table, in its order; FileNotFoundError for a table it does not have."""
    path = FOLDER / f"{table}.csv"
    if not path.exists():
        known = sorted(file.stem for file in FOLDER.glob("*.csv"))
        raise FileNotFoundError(f"{path}: the paper has numbers for the tables {known}, not for {table!r}")
    return pd.read_csv(path)
