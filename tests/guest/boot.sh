#!/usr/bin/env bash
# Boots the virtual machine of setup.sh and runs a command in it, as root, in this folder and with this machine's files;
# what it changes of them is lost. The folder $RESULTS (build/guest/results) of this machine can be written to.
# Ends with the command's status. Emulated without KVM unless SYNCWATCH_GUEST_KVM=1: that a machine has /dev/kvm does not
# mean that it works.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
guest=$root/build/guest
version=$(cat "$guest/version")
timeout_s=${GUEST_TIMEOUT_S:-1500}
work=$(mktemp -d "$guest/boot.XXXXXX")
trap 'rm -rf "$work"' EXIT
results=$guest/results
mkdir -p "$results" "$work/initramfs"/{bin,modules,host,results,overlay,proc,sys,dev}
rm -f "$results/status"

printf '%q ' "$@" > "$results/command"
cp "$(command -v busybox)" "$work/initramfs/bin/busybox"
needed=(virtio_pci 9pnet_virtio 9p overlay)
for module in "${needed[@]}"; do
    modprobe -d "$guest/root" -S "$version" --show-depends "$module" 2> /dev/null | sed -n 's/^insmod //p'
done | awk '!seen[$0]++' > "$work/order"
while read -r file; do
    name=$(basename "$file")
    cp "$file" "$work/initramfs/modules/$name"
    case $name in *.xz) xz -d "$work/initramfs/modules/$name"; name=${name%.xz};; esac
    echo "$name"
done < "$work/order" > "$work/initramfs/modules/order"

cat > "$work/initramfs/init" << INIT
#!/bin/busybox sh
/bin/busybox --install -s /bin
mount -t proc proc /proc; mount -t sysfs sysfs /sys; mount -t devtmpfs dev /dev
while read name; do insmod /modules/\$name; done < /modules/order
mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=512000,cache=loose host /host
mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000 results /results
mount -t tmpfs -o size=70% tmpfs /overlay
mkdir /overlay/upper /overlay/work /overlay/root
mount -t overlay -o lowerdir=/host,upperdir=/overlay/upper,workdir=/overlay/work overlay /overlay/root
for each in proc sys dev; do mount --move /\$each /overlay/root/\$each; done
mkdir -p /overlay/root/dev/pts /overlay/root/dev/shm
mount -t devpts devpts /overlay/root/dev/pts
mount -t tmpfs shm /overlay/root/dev/shm
mount --bind /results /overlay/root$results
ip link set lo up
exec chroot /overlay/root /bin/sh $root/tests/guest/inside.sh $root
INIT
chmod +x "$work/initramfs/init"
(cd "$work/initramfs" && find . | cpio --quiet -o -H newc | gzip -1) > "$work/initramfs.gz"

# NumPy sorts by AVX2 where it is to be had, which crashes in QEMU's emulation of it.
accelerator=(-accel tcg,thread=multi -cpu max,avx2=off)
[ "${SYNCWATCH_GUEST_KVM:-}" = 1 ] && accelerator=(-accel kvm -cpu host)
timeout --kill-after=5 "$timeout_s" qemu-system-x86_64 "${accelerator[@]}" -machine q35 -smp 2 -m 1536 \
    -display none -monitor none -no-reboot -nodefaults \
    -kernel "$guest/vmlinuz" -initrd "$work/initramfs.gz" \
    -append "console=ttyS0 tsc=reliable clocksource=tsc mitigations=off nokaslr quiet panic=-1" \
    -serial "file:$results/kernel.log" -serial stdio \
    -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap \
    -device virtio-9p-pci,fsdev=host,mount_tag=host \
    -fsdev "local,id=results,path=$results,security_model=none" \
    -device virtio-9p-pci,fsdev=results,mount_tag=results < /dev/null || {
    echo "the guest did not end within $timeout_s s; its last words:" >&2
    tail -n 20 "$results/kernel.log" >&2
    exit 1
}
[ -s "$results/status" ] || { echo "the guest ended early; its last words:" >&2; tail -n 20 "$results/kernel.log" >&2; exit 1; }
exit "$(cat "$results/status")"
