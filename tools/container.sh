#!/usr/bin/env bash
# Builds the container as root without a registry and without a container engine that runs, and meshes a phantom in it.
#
#   tools/container.sh
#
# The base image comes from Debian's packages (mmdebstrap); buildah works in a plain chroot. Where an engine and a
# registry can be had, `podman build -t cortet .` is all it takes. Needs Debian's buildah and mmdebstrap, and 8 GB.
set -euo pipefail
cd "$(dirname "$0")/.."

folder=$(mktemp -d "${TMPDIR:-/tmp}/container.XXXXXX")
store=(buildah --root "$folder/images" --runroot "$folder/run" --storage-driver vfs)
container=
stop() {
    [[ -z $container ]] || "${store[@]}" rm "$container" >/dev/null || true
    rm -rf "$folder"
}
trap stop EXIT
trap 'exit 130' INT TERM

say() { printf 'container, %s s: %s\n' "$SECONDS" "$*" >&2; }

say "making the base image"
mmdebstrap --quiet --variant=minbase bookworm "$folder/base.tar"
base=$("${store[@]}" from scratch)
"${store[@]}" add --quiet "$base" "$folder/base.tar" / >/dev/null
"${store[@]}" commit --quiet "$base" localhost/base >/dev/null
"${store[@]}" rm "$base" >/dev/null
rm "$folder/base.tar"

say "building cortet"
# whoever this machine trusts, pip trusts while it builds
printf '[global]\ncert = /host-certificates/ca-certificates.crt\n' >"$folder/pip.conf"
"${store[@]}" bud --isolation chroot --quiet --build-arg BASE=localhost/base --tag cortet \
    --volume /etc/ssl/certs:/host-certificates:ro --volume "$folder/pip.conf:/etc/pip.conf:ro" . >"$folder/log" 2>&1 ||
    { tail -n 20 "$folder/log" >&2; exit 1; }
"${store[@]}" images --format '{{.Name}} {{.Size}}' | grep cortet

say "meshing a phantom in it"
container=$("${store[@]}" from cortet)
run() { "${store[@]}" run --isolation chroot "$container" -- "$@"; }
printf 'user %s\n' "$(run id -un)"
run sh -c 'touch /written 2>/dev/null || echo the image cannot be written to'
run entrypoint.sh phantom --ga 28 --subdivisions 4 -o /tmp/x.surf.gii
run entrypoint.sh mesh /tmp/x.surf.gii --ga 28 --cell-size 2 -o /tmp/x.vtu --page /tmp/x.html
run entrypoint.sh picture /tmp/x.vtu -o /tmp/x.png

say "and a dataset"
case=/tmp/data/sub-01/anat/sub-01_hemi-L_white.surf.gii
run sh -c "mkdir -p $(dirname $case) && mv /tmp/x.surf.gii $case"
printf 'participant_id\tscan_age\nsub-01\t28\n' | run sh -c 'cat >/tmp/data/participants.tsv'
run entrypoint.sh run /tmp/data /tmp/out --cell-size 3 --cores 1
run sh -c 'ls /tmp/x.png /tmp/out/cohort/index.html'
