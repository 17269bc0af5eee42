"""Failed rows tried again: the parts that have some, and what was made from them."""

from dataclasses import replace

from ..common.errors import RsaDataError, UsageError
from ..store.tables import WorkDir
from . import jobs, stages
from .chains import RunOptions, run_job
from .status import outdated


def retry_failed(work: WorkDir, datasets: list[str], how: RunOptions) -> None:
    """Does the parts with failed rows again, in the order data flows, and what came from them.

    A table whose last run was killed between its last part and its manifest is finished too. Parts
    that were never done are left to their own command. A table that cannot be done again
    holds up no other: all are tried. Raises RsaDataError in the end when a table was made by
    options that cannot be found again, a part stays undone, or every row of a table still fails.
    """
    if how.start_over:
        raise UsageError("retry-failed keeps what is good: leave out --start-over")
    order, failures = stages.names(), list[RsaDataError]()
    for dataset in datasets:
        made = {
            name: work.table(dataset, name).description().stage for name in work.tables(dataset)
        }
        names = [name for name in made if made[name] in order]
        for name in sorted(names, key=lambda name: (order.index(made[name]), name)):
            table = work.table(dataset, name)
            killed = not table.complete() and not table.missing()
            failed = any(receipt.failed for receipt in table.receipts(table.parts()))
            if killed or failed or outdated(work, table):
                try:
                    run_job(jobs.job_of(work, dataset, name), replace(how, redo_failed=True))
                except RsaDataError as error:
                    failures.append(error)
    if len(failures) == 1:
        raise failures[0]
    if failures:
        said = "\n".join(str(error) for error in failures)
        raise RsaDataError(f"{len(failures)} tables could not be done again:\n{said}")
