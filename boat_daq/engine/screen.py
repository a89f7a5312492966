"""Whether Qt can open a window here, found out before Qt is asked: it ends the program where it cannot.

Only Linux is examined: first the plugin that draws, whose libraries belong to the system, then the display itself.
Source: Qt for X11 requirements, https://doc.qt.io/qt-6/linux-requirements.html.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import socket
import sys
from importlib.util import find_spec
from pathlib import Path

from protocol.base.errors import RequestError

WITHOUT_WINDOW = "without a window: boat-daq demo --headless"
DEBIAN = {  # libraries of the system that Qt's plugins load, and their packages in Debian and Ubuntu
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11-xcb.so.1": "libx11-xcb1",
    "libdbus-1.so.3": "libdbus-1-3",
    "libfontconfig.so.1": "libfontconfig1",
    "libfreetype.so.6": "libfreetype6",
    "libglib-2.0.so.0": "libglib2.0-0",
    "libxcb-cursor.so.0": "libxcb-cursor0",
    "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-image.so.0": "libxcb-image0",
    "libxcb-keysyms.so.1": "libxcb-keysyms1",
    "libxcb-randr.so.0": "libxcb-randr0",
    "libxcb-render-util.so.0": "libxcb-render-util0",
    "libxcb-shape.so.0": "libxcb-shape0",
    "libxcb-xkb.so.1": "libxcb-xkb1",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0",
    "libxkbcommon.so.0": "libxkbcommon0",
}
ARCH = {"libxcb-cursor.so.0": "xcb-util-cursor", "libxkbcommon-x11.so.0": "libxkbcommon-x11", "libEGL.so.1": "libglvnd"}


def require_screen() -> None:
    """Return if a window can be opened here. RequestError: it cannot; names the cause and the remedy."""
    if not sys.platform.startswith("linux"):
        return
    chosen = os.environ.get("QT_QPA_PLATFORM", "").partition(":")[0].partition(";")[0]
    if chosen and not chosen.startswith(("xcb", "wayland")):
        _require_plugin(chosen)
        return
    if not chosen.startswith("xcb") and _wayland_answers():
        return
    _require_plugin("xcb")
    _require_x_display()


def screen_error() -> RequestError | None:
    """Return why no window can be opened here; None if one can."""
    try:
        require_screen()
    except RequestError as error:
        return error
    return None


def missing_library(error: Exception) -> RequestError | None:
    """Return the error for a library of the system that cannot be loaded; None if `error` names none.

    The others that are missing are named too, so that one installation is enough.
    """
    found = re.search(r"(lib[\w+.-]+\.so[.\d]*): ", str(error))
    if found is None:
        return None
    missing = [found[1], *(name for name in DEBIAN if name != found[1] and not _loads(name))]
    command = _install(missing)
    remedy = "Install it" if len(missing) == 1 else "Install them"
    cause = f"the window needs {', '.join(missing)}, which this system lacks or cannot load"
    return RequestError(cause, remedy if command else f"{remedy} by the package manager", command=command)


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _install(libraries: list[str]) -> str:
    """Return the command of this distribution that installs libraries; empty where it is not known."""
    if shutil.which("apt-get"):
        names = sorted(DEBIAN[library] for library in libraries if library in DEBIAN)
        return f"sudo apt-get install {' '.join(names)}" if names else ""
    for manager in ("dnf", "zypper"):  # both install what provides a library
        if shutil.which(manager):
            provided = " ".join(f"'{library}()(64bit)'" for library in libraries)
            return f"sudo {manager} install {provided}"
    if shutil.which("pacman"):
        names = sorted({ARCH.get(library, "") for library in libraries} - {""})
        return f"sudo pacman -S {' '.join(names)}" if names else f"pacman -F {libraries[0]}"
    return ""


def _plugins() -> Path | None:
    """Return the folder of Qt's platform plugins; None where Qt is not installed as PySide6 installs it."""
    spec = find_spec("PySide6")
    places = (spec.submodule_search_locations if spec else None) or ()
    found = (Path(place) / "Qt" / "plugins" / "platforms" for place in places)
    return next((folder for folder in found if folder.is_dir()), None)


def _require_plugin(name: str) -> None:
    """Load a platform plugin as Qt does. RequestError: it does not exist, or a library that it needs does not."""
    folder = _plugins()
    if folder is None:
        return
    plugin = folder / f"libq{name}.so"
    if not plugin.is_file():
        known = ", ".join(sorted(path.stem.removeprefix("libq") for path in folder.glob("libq*.so")))
        cause = f"QT_QPA_PLATFORM is {name!r}, which Qt does not know"
        raise RequestError(cause, f"Unset it, or choose one of: {known}.")
    try:
        ctypes.CDLL(str(plugin))
    except OSError as error:
        raise (missing_library(error) or RequestError(f"Qt cannot be loaded: {error}", WITHOUT_WINDOW)) from error


def _wayland_answers() -> bool:
    """Return whether a Wayland display accepts connections and Qt's plugin for it can be loaded."""
    name = os.environ.get("WAYLAND_DISPLAY", "")
    folder = os.environ.get("XDG_RUNTIME_DIR", "")
    if not name:
        return False
    try:
        with socket.socket(socket.AF_UNIX) as display:
            display.settimeout(2)
            display.connect(str(Path(folder) / name))
        _require_plugin("wayland")
    except (OSError, RequestError):
        return False
    return True


def _require_x_display() -> None:
    """Connect to the X display. RequestError: none is named, or the one that is does not answer."""
    name = os.environ.get("DISPLAY", "")
    if not name:
        wayland = os.environ.get("WAYLAND_DISPLAY", "")
        raise RequestError(
            f"the display {wayland} does not answer"
            if wayland
            else "there is no display for the window: neither DISPLAY nor WAYLAND_DISPLAY names one",
            f"Start it in a desktop session, over SSH with `ssh -X`, or {WITHOUT_WINDOW}",
        )
    try:
        xcb = ctypes.CDLL("libxcb.so.1")
    except OSError as error:
        raise (missing_library(error) or RequestError(f"libxcb cannot be loaded: {error}", WITHOUT_WINDOW)) from error
    xcb.xcb_connect.restype = ctypes.c_void_p
    xcb.xcb_connection_has_error.argtypes = xcb.xcb_disconnect.argtypes = [ctypes.c_void_p]
    connection = xcb.xcb_connect(None, None)
    refused = xcb.xcb_connection_has_error(connection)
    xcb.xcb_disconnect(connection)
    if refused:
        cause = f"the display {name} does not answer, or refuses this user"
        raise RequestError(cause, f"Correct DISPLAY (this session's own display is often :0), or {WITHOUT_WINDOW}")
