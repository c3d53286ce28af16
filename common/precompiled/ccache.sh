#!/bin/sh
# ccache.sh SOURCE_FOLDER COMPILER ARGUMENT...: compiles with ccache.
#
# Checkouts in different folders have the same objects. The compiler's own list of what a file
# includes tells what it depends on, so that nothing is preprocessed twice. The sloppiness is what
# ccache's manual asks for with precompiled headers; no file of ours uses __TIME__. A precompiled
# header has hundreds of megabytes: its checksum lies beside it, so that ccache need not read it
# for each file that includes it.
export CCACHE_BASEDIR="$1" CCACHE_NOHASHDIR=1 CCACHE_DEPEND=1 CCACHE_PCH_EXTSUM=1
export CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime
shift
output= before=
for argument; do
  if [ "$before" = -o ]; then output=$argument; fi
  before=$argument
done
case "$output" in
  *.gch | *.pch)
    rm -f "$output.sum"
    ccache "$@" && sha256sum <"$output" >"$output.sum" ;;
  *) exec ccache "$@" ;;
esac
