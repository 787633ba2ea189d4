"""The run in the layout of the authors' released dataset (docs/released.md).

released/surfaces/<class>/<object>.npy
        /images/<class>/<object>/unoccluded.png, <grasp>.png
        /scene_info/<class>/<object>/<grasp>.npy
        /sheets/<class>/<object>/sheets_<grasp>_<sensor>.npy    if the run has touch charts
        /split.npy, /empty_gel.npy
"""

from workflow.run.job import log_to

import logging

from palpate import Dataset
from palpate.released.export import STAGES, export

log_to(snakemake.log[0])
logging.info("%d objects written", export(Dataset(".", STAGES), snakemake.output.folder))
