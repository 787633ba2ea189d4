"""What a family of experiments is trained and measured on, in one file; of these arrays, those that it sees.

packs/<family>.h5    object, class, split    (o,)                      string
                     points                  (o, n, 3)                 float32    m, world frame
                     unoccluded              (o, p, p, 3)              uint8
                     occluded                (o, g, p, p, 3)           uint8
                     views                   (o, v, q, q, 3)           uint8
                     camera                  (o, v, 3, 4)              float32    world, m, to pixels
                     success                 (o, g, 4)                 bool
                     position, rotation      (o, g, 4, 3 (, 3))        float32    m, world frame
                     charts                  (o, g, 4, 81, 3)          float32    m, world frame
                     reading                 (o, g, 4, r, r, 3)        uint8
                     empty_reading           (r, r, 3)                 uint8
"""

import logging

from palpate.batch import log_to
from palpate.training import families, pack

log = logging.getLogger(__name__)
log_to(snakemake.log[0])
family = snakemake.wildcards.family
plan = families.scene(family)
log.info("%s", plan)
stores = {stage: snakemake.input[stage] for stage in families.stages(family, plan)}
pack.write(snakemake.output.pack, family, snakemake.input.catalogue, stores, plan)
