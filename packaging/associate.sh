#!/bin/sh
# Enter the program in this user's menu of applications, and open .boat files with it. Linux desktops, no root.
#
#   associate.sh PROGRAM     PROGRAM is boat-daq of a bundle or an environment
set -eu
[ $# = 1 ] || { echo "usage: associate.sh PROGRAM" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
program=$(cd "$(dirname "$1")" && pwd)/$(basename "$1")
[ -x "$program" ] || { echo "$program is not a program" >&2; exit 1; }
share=${XDG_DATA_HOME:-$HOME/.local/share}
icon=$here/boat-daq.svg
[ -e "$icon" ] || icon=$here/../boat_daq/gui/boat-daq.svg
mkdir -p "$share/applications" "$share/mime/packages" "$share/icons/hicolor/scalable/apps"
sed "s|^Exec=boat-daq |Exec=\"$program\" |" "$here/boat-daq.desktop" >"$share/applications/boat-daq.desktop"
cp "$here/boat-daq.xml" "$share/mime/packages/"
cp "$icon" "$share/icons/hicolor/scalable/apps/"
if command -v update-mime-database >/dev/null; then update-mime-database "$share/mime"; fi
if command -v update-desktop-database >/dev/null; then update-desktop-database "$share/applications"; fi
echo "boat-daq is in the menu, and opens .boat files"
