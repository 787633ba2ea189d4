"""A run's grasps in layouts that other tools read: WebDataset, Zarr, and Parquet with images."""

from palpate.interchange.folder import FORMATS, export

__all__ = ["FORMATS", "export"]
