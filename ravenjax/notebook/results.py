"""The class CampaignResults: tables, rates and figures of the results of a campaign."""

from __future__ import annotations

import functools
import io
import weakref
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from ravenjax.campaign.file import location
from ravenjax.errors import UserError, describe_unknown_name, format_value
from ravenjax.store import manifest as manifests
from ravenjax.store import schema
from ravenjax.store.folder import Results
from ravenjax.store.manifest import Manifest

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    from matplotlib.figure import Figure

    from ravenjax.report.data.runs import Runs


def _style() -> AbstractContextManager[None]:
    # Returns a context in which matplotlib uses ravenjax's style.
    import matplotlib

    from ravenjax.document.figure_style import STYLE

    return matplotlib.rc_context(STYLE)


class ShownFigure:
    """A figure that a notebook shows. `figure` is the matplotlib figure, to change or save."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def savefig(self, path: str | io.StringIO, **options: object) -> None:
        """Write the figure to a file; the arguments are those of matplotlib."""
        with _style():
            self.figure.savefig(path, **options)  # pyright: ignore[reportArgumentType]

    def _repr_svg_(self) -> str:
        text = io.StringIO()
        self.savefig(text, format="svg", metadata={"Date": None})
        return text.getvalue()


def column_meanings(shape: schema.Shape) -> dict[str, dict[str, str]]:
    """Return {"units": {column: unit}, "meanings": {column: meaning}} of a result table."""
    columns = schema.table_columns(shape)
    return {
        "units": {column.name: column.unit for column in columns},
        "meanings": {column.name: column.meaning for column in columns},
    }


_WORST = ("run_id", "index", "group", "fault", "response", "hazard", "verdict")


class CampaignResults:
    """The results of a campaign, one row per run.

    `Campaign.run` and `open_results` return such objects. The table may be larger than memory:
    methods read only what they need. As in the report, counts are of distinct faults. If a fault
    was run several times, only its first valid run without a reaction of the operator counts. Raise
    StoreError if a file is missing or damaged.
    """

    def __init__(self, folder: str | Path, results: Results | None = None) -> None:
        """folder: result folder. results: object that keeps a temporary folder from deletion."""
        self.folder = location.require_path("folder", folder, "a result folder")
        self._manifest = manifests.read_manifest(self.folder)
        self._results = results or Results(self._manifest.shape, self.folder)

    @property
    def manifest(self) -> Manifest:
        """The record of what was computed, by which code, on which device."""
        return self._manifest

    def __len__(self) -> int:
        return self._manifest.done

    def to_pandas(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return the table, or some columns, as a DataFrame. attrs: units and meanings."""
        frame = self._results.frame(columns)
        frame.attrs.update(column_meanings(self._manifest.shape))
        return frame

    def to_arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns, as an Arrow table ordered by `index`."""
        return self._results.arrow(columns)

    def query(self, sql: str) -> pd.DataFrame:
        """Run an SQL query on `results` and on `facts`, which the report computes from `results`.

        Join the tables on the column `row`. Example: `results.query("SELECT site, count(*) AS n
        FROM facts WHERE evaded GROUP BY site")`. Raise UserError for an invalid query.
        """
        import duckdb

        if not isinstance(sql, str):
            raise UserError(f"sql is {format_value(sql)}, expected a query (text)")
        example = "SELECT * FROM facts LIMIT 5"
        try:
            kinds = [statement.type for statement in duckdb.extract_statements(sql)]
            if kinds != [duckdb.StatementType.SELECT]:
                got = format_value(sql)
                raise UserError(f"sql is {got}, expected one query, such as {example}")
            return self._runs.table.frame(sql)
        except duckdb.Error as error:
            reason = str(error).strip().splitlines()[0].rstrip(".")
            tables = f"The tables are results and facts; see {example}"
            raise UserError(f"sql: {reason}. {tables}") from None

    def rates(
        self, event: str | Sequence[str] = "evades", by: str | Sequence[str] = "group"
    ) -> pd.DataFrame:
        """Return the rate of each event in each class of faults, with a row for each.

        k: distinct faults with the event. n: distinct faults in the class. rate: k / n, with the
        95 % Wilson interval low, high (NaN for enumerated faults, because nothing was sampled).

        event: names of events, as for `[stop] rates`. by: names of columns. Faults of equal values
        in these columns form a class; (): all faults form one class. A name is group, site, layer,
        block (site and effect), response, hazard, outcome, a key of the first fault (effect, ..),
        the path of a varied parameter, or a column. Raise UserError for an unknown name.
        """
        from ravenjax.notebook import rates

        names, classes = rates.as_list(event, "event"), rates.as_list(by, "by")
        return rates.rates(self._runs, self._manifest.rules, names, classes)

    def worst(self, n: int = 10, by: str = "unintended") -> pd.DataFrame:
        """Return at most n valid runs with a fault, the worst first.

        by: what orders the runs: unintended, loss, report (false report), tissue (depth), cue (its
        duration) or response (its delay). The last column has this measure; attrs have its unit and
        meaning. Runs with the value 0 are left out.
        """
        import pandas as pd

        from ravenjax.report import wording
        from ravenjax.report.run import ranking

        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise UserError(f"n is {format_value(n)}, expected a number of runs, 1 or more")
        if by not in ranking.RANKINGS:
            raise UserError(f"by: {describe_unknown_name('quantity', by, ranking.RANKINGS)}")
        ranked = ranking.worst_runs(self.folder, n, by)
        measure, robot = ranking.RANKINGS[by], self._manifest.robot
        name, lines = f"{measure.name}_{measure.unit}", []
        rows = self._runs.whole_rows([run.row for run in ranked])
        for row, run in zip(rows, ranked, strict=True):
            lines.append(row | {"fault": wording.describe_fault(row, robot), name: run.value})
        table = pd.DataFrame(lines, columns=[*_WORST, name])
        table.attrs.update({"units": {name: measure.unit}, "meanings": {name: measure.meaning}})
        return table

    def explain(
        self, runs: int | str | Sequence[int | str] | None = None, engine: str = "auto"
    ) -> pd.DataFrame:
        """Return how errors propagate through signals, as the function `explain` does."""
        from ravenjax.notebook import explaining

        return explaining.explain_table(self.folder, runs, engine)

    def plot_verdicts(self) -> ShownFigure:
        """Plot the number of distinct faults of each group by outcome."""
        return self._plot("verdicts", "no run has a fault")

    def plot_time_to_know(self) -> ShownFigure:
        """Plot delays from a fault's first effect to a cue, to an alarm or stop, and to either."""
        return self._plot("time_to_know", "no fault had an effect")

    def plot_roc(self) -> ShownFigure:
        """Plot ROC curves: recall of unintended motions (y) over the false-positive rate (x)."""
        return self._plot("roc", "the campaign has no [[detector]]")

    def plot_tradeoff(self) -> ShownFigure:
        """Plot haptic sets: share of unintended motions without a cue (y), false cues per h (x)."""
        return self._plot("tradeoff", "the results contain no fault-free motion")

    def plot_chain(self, run: int | str, engine: str = "auto") -> ShownFigure:
        """Compute a run again, and plot over time which signals differ from the golden run.

        run: index, run id, or first letters of a run id.
        """
        from ravenjax.notebook import explaining

        absent = f"nothing differs from the golden run in run {run}"
        return self._figure(lambda _: explaining.explain_figure(self.folder, run, engine), absent)

    def _plot(self, name: str, absent: str) -> ShownFigure:
        from ravenjax.report import paper

        return self._figure(lambda runs: paper.draw_figure(runs, name), absent)

    def _figure(self, drawn: Callable[[Runs], Figure | None], absent: str) -> ShownFigure:
        # Draws a figure. absent: what the results lack if there is nothing to draw.
        with _style():
            figure = drawn(self._runs)
        if figure is None:
            raise UserError(f"there is nothing to draw: {absent}")
        return ShownFigure(figure)

    @functools.cached_property
    def _runs(self) -> Runs:
        # Opens the result table; it is closed when this object is deleted.
        from ravenjax.report.data.runs import Runs

        runs = Runs.open(self.folder, self._manifest)
        weakref.finalize(self, runs.close)
        return runs

    def __repr__(self) -> str:
        return f"<results of {self._manifest.campaign}: {len(self):,} runs, in {self.folder}>"

    def _repr_html_(self) -> str:
        from ravenjax.notebook import card

        return card.of_results(self._runs, self._manifest)
