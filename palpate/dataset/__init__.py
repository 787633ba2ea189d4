"""The dataset of a run: all its stores read as one (`Dataset`), without engines, and their validation, with them."""

from palpate.dataset.grasps import GraspDataset
from palpate.dataset.reader import Dataset, GraspRecord, ObjectRecord
from palpate.dataset.summary import summary

__all__ = ["Dataset", "GraspDataset", "GraspRecord", "ObjectRecord", "summary"]
