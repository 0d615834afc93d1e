# What the virtual machine does: runs the command that boot.sh was given, prints to its terminal, leaves the status.
cd "$1"
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/dev/shm TMPDIR=/dev/shm LANG=C.UTF-8 PYTHONDONTWRITEBYTECODE=1
export GUEST_MODULES="$1/build/guest/root" SYNCWATCH_GUEST=1
{
    sh -c "$(cat build/guest/results/command)"
    echo $? > build/guest/results/status
} > /dev/ttyS1 2>&1 < /dev/null
sync
echo o > /proc/sysrq-trigger
sleep 60
