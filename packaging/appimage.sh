#!/bin/sh
# Make one file of a bundle: an AppImage (type 2), which is a runtime with a compressed image of the folder behind it.
#
#   appimage.sh FOLDER RUNTIME FILE.AppImage
#
# RUNTIME is that of https://github.com/AppImage/type2-runtime; it mounts the image, or with --appimage-extract-and-run
# unpacks it where no FUSE is.
set -eu
folder=$1 runtime=$2 out=$3
here=$(cd "$(dirname "$0")" && pwd)
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/usr"
cp -a "$folder" "$root/usr/boat-daq"
ln -s boat-daq/_internal/share "$root/usr/share"
ln -s usr/boat-daq/boat-daq "$root/AppRun"
cp "$here/boat-daq.desktop" "$here/../boat_daq/gui/boat-daq.svg" "$root/"
ln -s boat-daq.svg "$root/.DirIcon"
mksquashfs "$root" "$out.image" -root-owned -noappend -no-progress -quiet -comp zstd -Xcompression-level 6 -b 1M
cat "$runtime" "$out.image" >"$out"
rm "$out.image"
chmod +x "$out"
