"""The one executor of the package: jobs side by side, on this machine or on a Dask cluster.

Everything is written against concurrent.futures.Executor. batch.py hands jobs to one and collects,
local.py is processes here, cluster.py these or an existing Dask cluster.
"""
