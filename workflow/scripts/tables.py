"""Tables of the dataset, the paper's values beside.

tables/dataset_statistics.csv    objects, splits, grasps, touches, % successful, by class
tables/grasp_success.csv         share of grasps with 1, 2, 3 and 4 successful touches
tables/penetration.csv           how deep the hand is in the object or in itself, mm
tables/*.md, tables/*.tex        the same as Markdown and as LaTeX
"""

from palpate.batch import log_to
from palpate.results import dataset_tables as tables

log_to(snakemake.log[0])
frames = tables.dataset_frames(".")
output = snakemake.output
tables.write_table(tables.dataset_statistics(*frames), output.statistics)
tables.write_table(tables.grasp_success(frames.objects, frames.grasps), output.success)
if output.penetration:  # a released dataset says nothing of it
    tables.write_table(tables.penetration(frames.objects, frames.grasps), output.penetration)
