"""Timings of hystjax beside other ways to do the same, in one run.

`python -m benchmarks` from the repository's root runs them all and writes `RESULTS.md`
and `results.json` here; `--help` says more.
"""
