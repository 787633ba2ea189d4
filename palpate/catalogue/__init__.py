"""Which objects a run has: their sources, classes, splits and batches; and what a stage does with a batch."""

from palpate.catalogue.batch import Rejection, Unusable, each_object, generator, write_rejections

__all__ = ["Rejection", "Unusable", "each_object", "generator", "write_rejections"]
