"""Parallel jobs, on this machine or on a Dask cluster.

All executors are concurrent.futures.Executor. batch.py submits jobs and collects results, local.py
runs local processes, cluster.py those or an existing Dask cluster.
"""
