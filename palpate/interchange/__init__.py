"""A run's grasps in layouts that other tools read: WebDataset, and Parquet with images as Hugging Face's `datasets`."""

from palpate.interchange.folder import FORMATS, export

__all__ = ["FORMATS", "export"]
