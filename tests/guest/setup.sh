#!/usr/bin/env bash
# Fetches what a virtual machine with virtual cameras is made of: QEMU, Debian's kernel with the driver vivid, and
# v4l2loopback built for it. All of it goes to build/guest, once; needs Debian on x86-64 and, the first time, root.
set -euo pipefail
cd "$(dirname "$0")/../.."

guest=build/guest
ready=$guest/ready-$(sha256sum < tests/guest/setup.sh | cut -c 1-12)
[ -e "$ready" ] && exit 0
[ "$(uname -m)" = x86_64 ] && command -v apt-get > /dev/null || { echo "guest tests need Debian on x86-64" >&2; exit 2; }

tools=(qemu-system-x86 busybox-static kmod cpio v4l-utils gcc make xz-utils)
image=$(apt-cache depends linux-image-amd64 | sed -n 's/^ *Depends: \(linux-image-.*\)$/\1/p' | head -n 1)
if [ -z "$image" ] || ! dpkg --status "${tools[@]}" > /dev/null 2>&1; then
    apt-get update -qq
    apt-get install -y -qq --no-install-recommends "${tools[@]}" > /dev/null
    image=$(apt-cache depends linux-image-amd64 | sed -n 's/^ *Depends: \(linux-image-.*\)$/\1/p' | head -n 1)
fi
version=${image#linux-image-}
headers=linux-headers-$version
common=$(apt-cache depends "$headers" | sed -n 's/^ *Depends: \(linux-headers-.*-common\)$/\1/p')
kbuild=$(apt-cache depends "$headers" | sed -n 's/^ *Depends: \(linux-kbuild-.*\)$/\1/p')

rm -rf "$guest"
mkdir -p "$guest/packages" "$guest/unpacked"
(cd "$guest/packages" && apt-get download -qq -o APT::Sandbox::User=root "$image" "$headers" "$common" "$kbuild" v4l2loopback-dkms)
for package in "$guest"/packages/*.deb; do dpkg-deb -x "$package" "$guest/unpacked"; done

# The headers name each other by absolute paths: they are read from where they were unpacked instead.
unpacked=$(readlink -f "$guest/unpacked")
kernel=$unpacked/usr/src/$headers
sed -i "s#/usr/src/#$unpacked/usr/src/#g" "$kernel/Makefile"
for link in "$kernel"/scripts "$kernel"/tools; do
    [ -L "$link" ] && ln -sfn "$unpacked/usr/lib/$kbuild/$(basename "$link")" "$link"
done

modules=$guest/root/lib/modules/$version
mkdir -p "$modules/extra"
for part in drivers/media drivers/virtio fs/9p fs/netfs fs/fscache fs/overlayfs net/9p; do
    mkdir -p "$modules/kernel/$part"
    cp -r "$unpacked/lib/modules/$version/kernel/$part/." "$modules/kernel/$part" 2> /dev/null || true
done
cp "$unpacked/lib/modules/$version"/modules.{order,builtin,builtin.modinfo} "$modules"
cp "$unpacked/boot/vmlinuz-$version" "$guest/vmlinuz"
loopback=$(echo "$unpacked"/usr/src/v4l2loopback-*)
make -s -C "$kernel" "M=$loopback" modules > "$guest/loopback.log" 2>&1 || { cat "$guest/loopback.log" >&2; exit 1; }
cp "$loopback/v4l2loopback.ko" "$modules/extra"
depmod -b "$guest/root" "$version"
echo "$version" > "$guest/version"

rm -rf "$guest/packages" "$guest/unpacked"
touch "$ready"
