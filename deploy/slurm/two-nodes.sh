#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Starts and stops a Slurm controller and two virtual nodes of one CPU each on this machine, for
# tests. It needs root and the packages slurm-wlm and munge. All files but munge's key and socket are
# in DIR.
#
#     deploy/slurm/two-nodes.sh up DIR       prints SLURM_CONF=FILE, for the environment of umbraged
#     deploy/slurm/two-nodes.sh down DIR
#
# PORT: port of the controller (default 16817); the nodes take the two ports after it.
set -eu
action=${1:-}
folder=${2:-}
port=${PORT:-16817}
case $action:$folder in
up:/* | down:/*) ;;
*)
    echo "usage: two-nodes.sh up|down DIR (absolute)" >&2
    exit 2
    ;;
esac
SLURM_CONF=$folder/slurm.conf
export SLURM_CONF

down() {
    for name in slurmd-n1 slurmd-n2 slurmctld; do
        [ ! -s "$folder/$name.pid" ] || kill -9 "$(cat "$folder/$name.pid")" 2>/dev/null || true
        rm -f "$folder/$name.pid"
    done
}

if [ "$action" = down ]; then
    down
    exit 0
fi
for program in slurmctld slurmd munged sbatch; do
    command -v "$program" >/dev/null || {
        echo "two-nodes.sh: $program is not installed (slurm-wlm, munge)" >&2
        exit 69
    }
done
mkdir -p "$folder/state" "$folder/spool-n1" "$folder/spool-n2"
if ! munge -n </dev/null >/dev/null 2>&1; then
    install -d -o munge -g munge -m 0755 /run/munge
    install -d -o munge -g munge -m 0700 /var/log/munge
    su -s /bin/sh munge -c /usr/sbin/munged
fi
cat >"$SLURM_CONF" <<END
ClusterName=umbrage
SlurmctldHost=$(hostname)
SlurmUser=root
AuthType=auth/munge
SlurmctldPort=$port
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool-%n
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd-%n.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=1
JobRequeue=1
RequeueExit=75
RequeueExitHold=65
ReturnToService=2
SlurmdTimeout=10
SlurmctldTimeout=10
BatchStartTimeout=10
KillWait=2
MessageTimeout=5
MinJobAge=300
NodeName=n1 NodeHostname=$(hostname) Port=$((port + 1)) CPUs=1 RealMemory=1000 State=UNKNOWN
NodeName=n2 NodeHostname=$(hostname) Port=$((port + 2)) CPUs=1 RealMemory=1000 State=UNKNOWN
PartitionName=bake Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
END
slurmctld -c -f "$SLURM_CONF"
slurmd -N n1 -f "$SLURM_CONF"
slurmd -N n2 -f "$SLURM_CONF"
for _ in 1 2 3 4 5 6 7 8 9 10; do
    [ "$(sinfo -h -N -t idle 2>/dev/null | wc -l)" -lt 2 ] || {
        echo "SLURM_CONF=$SLURM_CONF"
        exit 0
    }
    sleep 1
done
echo "two-nodes.sh: the nodes do not come up; see the logs in $folder" >&2
exit 75
