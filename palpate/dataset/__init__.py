"""The dataset of a run: all its stores read as one (`Dataset`), and their validation (`validation`).

Reading needs no engine; `palpate.dataset.validation` loads the packages that made the data, and Embree.
"""

from palpate.dataset.grasps import GraspDataset
from palpate.dataset.reader import Dataset, GraspRecord, ObjectRecord
from palpate.dataset.summary import summary

__all__ = ["Dataset", "GraspDataset", "GraspRecord", "ObjectRecord", "summary"]
