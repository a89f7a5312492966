"""The commands of the models: how fine they compute, the optical sweep and search, the shadow, the trade-off."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from boat_daq.gui.registry import Command
from boat_daq.viewmodels.app_model import FIDELITIES
from boat_daq.viewmodels.live.shadow_live import SCALES

if TYPE_CHECKING:
    from boat_daq.gui.main_window import MainWindow

MENU = "Models"


def models(window: MainWindow) -> list[Command]:
    """Return the commands of the pages Optics, Shadow and Trade-off."""
    desk = window.desk

    def on(page: str, deed: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            window.go(page)
            desk.notices.attempt(deed)

        return run

    def next_colour() -> None:
        names = list(SCALES)
        desk.shadow.quantity = names[(names.index(desk.shadow.quantity) + 1) % len(names)]

    def show_cost() -> None:
        desk.shadow.show_cost = not desk.shadow.show_cost

    def sweep_map() -> None:
        desk.atlas.toggle(desk.tradeoff.shown)

    fidelities = [
        Command(MENU, f"Compute: {level}", f"Ctrl+Alt+{i}", partial(desk.set_fidelity, level))
        for i, level in enumerate(FIDELITIES, 1)
    ]
    return [
        *fidelities,
        Command(MENU, "Sweep all designs, or stop", "F9", on("Optics", desk.optics.toggle_sweep), apart=True),
        Command(MENU, "Optimise beyond the grid, or stop", "Shift+F9", on("Optics", desk.optics.toggle_search)),
        Command(MENU, "Colour the shadow by the next quantity", "Ctrl+F9", next_colour, apart=True),
        Command(MENU, "Show what a frame of the shadow costs", "Ctrl+Shift+F9", show_cost),
        Command(MENU, "Measure the trade-off, or stop", "F12", on("Trade-off", desk.tradeoff.toggle), apart=True),
        Command(MENU, "Map where the method fails, or stop", "Shift+F12", on("Trade-off", sweep_map)),
    ]
