"""tables/local_touch_charts.csv (.md, .tex): Chamfer distance (m^2 x 9000) of local predictions, by class."""

from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
touches = errors.read([snakemake.input.touches], errors.TOUCH_COLUMNS)
table = tables.local_touch_charts(touches, snakemake.params.split, snakemake.params.resamples)
tables.write_table(table, snakemake.output.table)
