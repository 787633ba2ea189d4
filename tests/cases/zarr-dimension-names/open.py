import sys

import xarray

print(xarray.open_zarr(sys.argv[1], consolidated=False))  # <run>/touch/batch-0000.zarr
