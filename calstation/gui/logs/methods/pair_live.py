"""The live monitoring of the IMUs of a station on one body."""

from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QWidget

from calstation.config import RunRequest, load_product, load_station, require_one_temperature
from calstation.connection import PairProcess, PairStatus
from calstation.errors import CalstationError
from calstation.gui.logs.methods.pair_parts import CheckBar, CheckBars, Timeline
from calstation.gui.logs.methods.pair_view import schedule_text, stored_text, unit_bars
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.state import AppContext
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import StateBadge, box, button, column, enable, label, panel, row, show_text, theme
from calstation.messages import Text
from calstation.physics import DEGREE_PER_HOUR, MICRO_G
from calstation.results import CorrectedTrace


class PairLiveView(QWidget):
    """A view that starts and stops the monitoring in a separate process, and shows its state."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self._app = app
        self._watch: PairProcess | None = None
        self._stopping = False
        self._station: tuple[Path | None, str] = (None, "")  #: File and name of the station monitored last.
        self.status: PairStatus | None = None
        self._error: CalstationError | None = None
        self._timer = QTimer(self, interval=100)
        self._timer.timeout.connect(self._poll)
        self.start_button = button("watch_button", "logs.watch_live", self._start_or_stop, kind="primary")
        self.check_button = button("watch_check_button", "logs.check_now", self._check, tip="logs.check_tip")
        self.badge, self.bars, self.timeline = StateBadge(), CheckBars(), Timeline()
        self.force_plot, self.rate_plot = MethodPlot(), MethodPlot(log=True)
        for plot in (self.force_plot, self.rate_plot):
            plot.setMinimumHeight(28 * theme.GRID)
        self.source_label = label(name="watch_source_label")
        self.schedule_label = label(wrap=True)
        self._clocks, self._stored = label(name="watch_clocks_label", wrap=True), label(wrap=True)
        self._failure = label(name="watch_failure_label", kind="caution", wrap=True)
        self._explanation = label("logs.watch_tip", "muted", wrap=True)
        clocks = row(label("logs.clocks", "section"), (self._clocks, 1), spacing=2 * theme.GRID)
        stored = row(label("logs.stored", "section"), (self._stored, 1), spacing=2 * theme.GRID)
        self._status = box(
            self.schedule_label,
            panel(label("logs.check_at_rest", "section"), self.bars),
            panel(self.timeline),
            panel(
                row(label("logs.corrected_data", "section"), None, self.source_label),
                row((self.force_plot, 1), (self.rate_plot, 1)),
            ),
            clocks,
            stored,
        )
        head = row(self.badge, None, self.check_button, self.start_button, spacing=theme.GRID)
        column(head, self._explanation, self._failure, self._status, None, on=self, margins=(0, theme.GRID, 0, 0))
        app.station_changed.connect(self._refresh)
        app.product_changed.connect(self._refresh)
        app.engine_link.running_changed.connect(self._refresh)
        app.windows.changed.connect(self._refresh)
        app.closing.connect(self.close_watch)
        app.run.stop_pressed.connect(self._stop)
        on_language_change(self, self._refresh)

    @property
    def watching(self) -> bool:
        """Whether the station is being monitored."""
        return self._watch is not None

    def close_watch(self) -> None:
        """End the monitoring and wait until its ports are closed."""
        if self._watch is not None:
            self._watch.close()
        self._watch = None
        self._app.run.set_monitoring(None)

    def _start_or_stop(self) -> None:
        if self.watching:
            self._stop()
            return
        self._error, self.status, self._stopping = None, None, False
        path = self._app.station_path
        self._station = path, load_station(path)[1].name
        self._watch = PairProcess(RunRequest("", path, self._app.product_path))
        self._timer.start()
        self._refresh()

    def _stop(self) -> None:
        if self._watch is not None:
            self._watch.send("stop")
            self._stopping = True
            self._refresh()

    def _check(self) -> None:
        if self._watch is not None:
            self._watch.send("check")

    def _poll(self) -> None:
        watch = self._watch
        if watch is None:
            return
        for report in watch.poll():
            if isinstance(report, PairStatus):
                self.status = report
            else:
                self._error = report
        if watch.ended:
            self._timer.stop()
            watch.close()
            self._watch = None
        self._refresh()

    def _refresh(self) -> None:
        kind, text = self._state()
        path, name = self._station
        if self.watching and path != self._app.station_path:
            text = Text.of("common.named", name=name, text=text)
        self._app.run.set_monitoring((kind, text) if self.watching else None)
        self.start_button.setText(say("logs.stop" if self.watching else "logs.watch_live"))
        enable(self.start_button, "" if self.watching else self._why_not())
        enable(self.check_button, "" if self.status is not None and self.watching else say("logs.start_watch"))
        self.badge.show_state(kind, say(text))
        show_text(self._failure, "" if self._error is None else say(self._error.as_text))
        status = self.status
        self._explanation.setVisible(status is None)
        self._status.setVisible(status is not None)
        if status is None:
            return
        self.schedule_label.setText(schedule_text(status.schedule))
        self.bars.show_bars(self._bars(status))
        progress = status.progress  # after monitoring, the timeline ends without a current state
        self.timeline.show_progress(progress if self.watching else replace(progress, duration=progress.time))
        self._show_corrected(status.corrected)
        self.source_label.setVisible(self.watching)
        self._clocks.setText("\n".join(self._clock_text(status, number) for number in status.alignments))
        self._stored.setText("\n".join(map(stored_text, status.stored)))

    def _show_corrected(self, trace: CorrectedTrace) -> None:
        """Draw the corrected output of all IMUs, with a bold line for the IMU whose output is valid."""
        names = {
            name: say("logs.primary" if name == "primary" else "logs.imu", number=name.removeprefix("imu"))
            for name in trace.force
        }
        valid = names.get(trace.source or "", say("logs.none"))
        self.source_label.setText(say("logs.outputs_valid", names=valid, switches=trace.switch_overs))
        c = theme.colours()
        colours = dict(zip(names, (c.accent, c.caution, c.muted), strict=False))
        for plot, caption, values, size in (
            (self.force_plot, say("logs.force_error"), trace.force, MICRO_G),
            (self.rate_plot, say("logs.rate_dph"), trace.rate, DEGREE_PER_HOUR),
        ):
            plot.empty()
            for name, colour in colours.items():
                plot.line(trace.time, values[name] / size, colour, bold=name == trace.source)
            legend = [(names[name], colour) for name, colour in colours.items()]
            plot.finish([(caption, c.text), *legend, (say("logs.axis_before_now"), c.muted)])

    def _why_not(self) -> str:
        if self._app.engine_link.running:
            return say("window.busy_run")
        if self._app.run.occupied is not None:
            return say(self._app.run.occupied)
        try:
            _, station = load_station(self._app.station_path)
        except CalstationError as error:
            return say(error.as_text)
        if not station.secondaries:
            return say("logs.one_imu")
        try:
            require_one_temperature(load_product(self._app.product_path)[1])
        except CalstationError as error:
            return say(error.as_text)
        return ""

    def _state(self) -> tuple[str, Text]:
        """Return the symbol and the text of the state."""
        if not self.watching:
            return "none", Text("logs.not_watching" if self.status is None else "logs.watch_ended")
        status = self.status
        if self._stopping:
            return "stopped", Text("logs.watch_stopping")
        if status is None:
            return "waiting", Text("logs.opening_ports")
        if 0 in status.silent:
            return "bad", Text("logs.no_primary_samples")
        if status.primary_off:
            return "caution", Text.of("logs.primary_out", sensors=status.primary_off)
        state = status.progress.state
        if state == "waiting":
            return "good", Text("logs.watching")
        return "active", Text.of(f"pair.state_{state}", percent=100.0 * status.progress.motion)

    def _bars(self, status: PairStatus) -> list[CheckBar]:
        bars: list[CheckBar] = []
        check = None
        for number in status.alignments:
            check = status.checks.get(number)
            bars += unit_bars(number, check, status.static.get(number, {}))
        return bars + unit_bars(0, check, {})

    def _clock_text(self, status: PairStatus, number: int) -> str:
        clock = status.alignments[number]
        if not clock.measured:
            return say("logs.clock_coarse", number=number, offset=clock.offset)
        micro = {"sigma": 1e6 * clock.sigma, "drift": 1e6 * clock.drift}
        return say("logs.clock_fine", number=number, offset=clock.offset, **micro)
