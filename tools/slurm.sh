#!/usr/bin/env bash
# Runs a command beside a SLURM cluster of its own: this machine as its one node, with an accounting database, on
# loopback and in a temporary folder; prints what the jobs took and stops everything again.
#
#   tools/slurm.sh snakemake --profile profiles/slurm
#
#   SLURM_CPUS=2  SLURM_MEMORY=4000   what the node is said to have (default: what the machine has; MB)
#   SLURM_PORTS=36817                 first of three free ports
#
# Needs Debian's slurm-wlm, slurmdbd, munge, mariadb-server-core and mariadb-client-core; no root and no systemd. Memory
# is watched by polling (no cgroups), so a job that takes too much is killed within seconds, not at once.
set -euo pipefail

programs=(munged slurmctld slurmd slurmdbd mariadbd mariadb-install-db)
PATH=$PATH:/usr/sbin:/sbin
for program in "${programs[@]}"; do
    command -v "$program" >/dev/null || {
        echo "$program is missing: apt-get install --no-install-recommends" \
            "slurm-wlm slurmdbd munge mariadb-server-core mariadb-client-core" >&2
        exit 2
    }
done

cpus=${SLURM_CPUS:-$(nproc)}
memory=${SLURM_MEMORY:-$(($(awk '/^MemTotal/ {print $2}' /proc/meminfo) * 9 / 10240))}
port=${SLURM_PORTS:-36817}
host=$(hostname -s)
folder=$(mktemp -d "${TMPDIR:-/tmp}/slurm.XXXXXX")
chmod 755 "$folder"
export SLURM_CONF=$folder/slurm.conf
daemons=()

stop() {
    trap - EXIT
    scancel --user="$(id -un)" 2>/dev/null && sleep 1
    # the last started first; the controller writes its last records to the database, which therefore goes last
    for ((number = ${#daemons[@]} - 1; number >= 0; number--)); do
        kill "${daemons[number]}" 2>/dev/null || continue
        wait "${daemons[number]}" 2>/dev/null || true
    done
    rm -rf "$folder"
}
trap stop EXIT
trap 'exit 130' INT TERM

start() { # NAME COMMAND...: in the background, with a log of its own
    local name=$1
    shift
    "$@" &>"$folder/$name.out" &
    daemons+=($!)
}

await() { # NAME COMMAND...: until it succeeds
    local name=$1 _
    shift
    for _ in {1..300}; do
        "$@" &>/dev/null && return
        sleep 0.2
    done
    echo "$name does not answer; the end of its log:" >&2
    tail -n 20 "$folder/$name.out" "$folder/$name.log" >&2 2>/dev/null || true
    exit 1
}

# --- who is who ------------------------------------------------------------------------------------------------------

dd if=/dev/urandom of="$folder/munge.key" bs=128 count=1 status=none
chmod 400 "$folder/munge.key"
munge_socket=$folder/munge.socket
start munge munged --foreground --force --key-file="$folder/munge.key" --socket="$munge_socket" \
    --pid-file="$folder/munge.pid" --log-file="$folder/munge.log" --seed-file="$folder/munge.seed"
await munge munge --no-input --socket="$munge_socket"

# --- the accounting database -----------------------------------------------------------------------------------------

maria=(--no-defaults --datadir="$folder/database" --user="$(id -un)")
mariadb-install-db "${maria[@]}" --auth-root-authentication-method=normal --skip-test-db &>"$folder/install.out"
start database mariadbd "${maria[@]}" --socket="$folder/database.socket" --skip-networking \
    --pid-file="$folder/database.pid" --innodb-buffer-pool-size=64M
await database mariadb --no-defaults --user=root --socket="$folder/database.socket" --execute="create database slurm"

(umask 077; cat >"$folder/slurmdbd.conf" <<END
AuthType=auth/munge
AuthInfo=socket=$munge_socket
DbdHost=localhost
DbdPort=$((port + 2))
SlurmUser=$(id -un)
LogFile=$folder/slurmdbd.log
PidFile=$folder/slurmdbd.pid
StorageType=accounting_storage/mysql
StorageHost=localhost
StorageUser=root
StorageLoc=slurm
END
)

# --- the cluster -----------------------------------------------------------------------------------------------------

cat >"$folder/slurm.conf" <<END
ClusterName=here
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
AuthType=auth/munge
AuthInfo=socket=$munge_socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
MailProg=/bin/true
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=1
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=localhost
AccountingStoreFlags=job_comment
AccountingStoragePort=$((port + 2))
AccountingStoragePass=$munge_socket
SlurmdParameters=config_overrides
KillWait=5
MinJobAge=3600
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$memory
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
END
mkdir "$folder/state" "$folder/spool"

export MYSQL_UNIX_PORT=$folder/database.socket
start slurmdbd slurmdbd -D
await slurmdbd sacctmgr --immediate --noheader show cluster
await slurmdbd sacctmgr --immediate add cluster here
start slurmctld slurmctld -D
await slurmctld scontrol ping
start slurmd slurmd -D
await slurmd sh -c '[ "$(sinfo --noheader --format=%t)" = idle ]'

# --- the work --------------------------------------------------------------------------------------------------------

# inside a job, Snakemake's plugin starts srun without SLURM_CONF, as on a cluster whose file is in its place
mkdir "$folder/bin"
printf '#!/bin/sh\nSLURM_CONF=%q exec %q "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$folder/bin/srun"
chmod +x "$folder/bin/srun"
export PATH=$folder/bin:$PATH

sinfo --Node --long
status=0
"$@" || status=$?

sleep 2 # the database hears of the last job a little later
sacct --allusers --format="${SLURM_COLUMNS:-JobID,State,Comment%-40,Elapsed,TotalCPU,AllocCPUS,ReqMem,MaxRSS}"
sacct --allusers --parsable2 --noheader --units=M --format=JobID,CPUTimeRAW,TotalCPU,ReqMem,MaxRSS | awk -F'|' '
    function seconds(text,    part, count, i, sum) { # [days-][hours:]minutes:seconds
        count = split(text, part, /[-:]/)
        for (i = 1; i <= count; i++) sum = sum * (i == 2 && text ~ /-/ ? 24 : 60) + part[i]
        return sum
    }
    $1 !~ /[.]/ { allocated += $2; used += seconds($3); asked[$1] = $4 + 0 }
    # steps follow each other, beside the batch script
    $1 ~ /[.]batch/ { split($1, id, "."); batch[id[1]] = $5 + 0 }
    $1 ~ /[.][0-9]/ { split($1, id, "."); if ($5 + 0 > step[id[1]]) step[id[1]] = $5 + 0 }
    END {
        for (job in batch) {
            share = (batch[job] + step[job]) / asked[job]
            sum += share
            if (share > most) most = share
            count++
        }
        if (!count) exit
        printf "%d jobs; CPU: %d s used of %d s allocated (%.0f %%); ", count, used, allocated, 100 * used / allocated
        printf "memory: %.0f %% of what was asked for on average, %.0f %% at most\n", 100 * sum / count, 100 * most
    }'
exit $status
