"""A run's grasps in layouts that other tools read: WebDataset, and Parquet with images as Hugging Face's `datasets`.

Both have a data card, `README.md` (`palpate.interchange.card`), and are written whole or not at all.
"""

from palpate.interchange.parquet import write_parquet
from palpate.interchange.webdataset import write_webdataset

# By the names that the command has for them.
FORMATS = {"webdataset": write_webdataset, "parquet": write_parquet}

__all__ = ["FORMATS", "write_parquet", "write_webdataset"]
