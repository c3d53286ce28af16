#!/bin/sh
# ccache.sh SOURCE_FOLDER COMPILER ARGUMENT...: compiles with ccache.
#
# Checkouts in different folders share the objects of files that are compiled alone; a unity file
# names its sources by their folder. The compiler's own list of what a file includes tells what it
# depends on, so that nothing is preprocessed twice. The sloppiness is what ccache's manual asks for
# with precompiled headers; no file of ours uses __TIME__.
#
# A precompiled header differs whenever it is made, even from the same headers. So ccache looks at a
# checksum beside it instead: of the command and of all headers in it, with the source folder's name
# left out. Then objects from before are found again when the precompiled header was made anew.
export CCACHE_BASEDIR="$1" CCACHE_NOHASHDIR=1 CCACHE_DEPEND=1 CCACHE_PCH_EXTSUM=1
export CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime
# All presets together have more than ccache's own 5 GB.
export CCACHE_MAXSIZE="${CCACHE_MAXSIZE:-20G}"
shift
output= dependencies= before=
for argument; do
  case "$before" in
    -o) output=$argument ;;
    -MF) dependencies=$argument ;;
  esac
  before=$argument
done
case "$output" in
  *.gch | *.pch)
    rm -f "$output.sum"
    ccache "$@" || exit
    { echo "$*" && sed 's/^[^ ]*: //; s/\\$//' "$dependencies" | xargs cat; } |
      sed "s#$CCACHE_BASEDIR##g" | sha256sum >"$output.sum" ;;
  *) exec ccache "$@" ;;
esac
