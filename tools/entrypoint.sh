#!/bin/sh
# What a container starts: `cortet` with the arguments it is given. The image may be read-only and the user may be any, so
# what libraries keep lies in a folder of the user's own, which begins with the kernels that were compiled into the image.
own=${TMPDIR:-/tmp}/cortet-$(id -u)
export XDG_CACHE_HOME="$own/cache" XDG_CONFIG_HOME="$own/config" MPLCONFIGDIR="$own/matplotlib"
if [ ! -d "$own/cache/cortet/kernels" ]; then
    mkdir -p "$own/cache/cortet" && cp -r /opt/cortet/kernels "$own/cache/cortet/" || exit 1
fi
exec cortet "$@"
