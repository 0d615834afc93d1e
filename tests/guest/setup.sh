#!/usr/bin/env bash
# Fetches what a virtual machine with virtual cameras is made of: QEMU, Debian's kernel with the driver vivid, and
# v4l2loopback built for it. All of it goes to build/guest, once; needs Debian on x86-64 and, the first time, root.
set -euo pipefail
cd "$(dirname "$0")/../.."

guest=build/guest
ready=$guest/ready-$(sha256sum < tests/guest/setup.sh | cut -c 1-12)
tools=(qemu-system-x86 busybox-static kmod cpio gcc make xz-utils)
export DEBIAN_FRONTEND=noninteractive LC_ALL=C PATH=$PATH:/usr/sbin:/sbin

are_installed() { [ "$(dpkg-query -Wf '${db:Status-Status}\n' "${tools[@]}" 2> /dev/null | grep -cx installed)" = ${#tools[@]} ]; }

[ "$(uname -m)" = x86_64 ] && command -v apt-get > /dev/null || { echo "guest tests need Debian on x86-64" >&2; exit 2; }
[ -e "$ready" ] && are_installed && exit 0

install_tools() {
    # Another program may be installing something: it is waited for.
    are_installed || apt-get -qq -o DPkg::Lock::Timeout=600 install -y --no-install-recommends "${tools[@]}" < /dev/null > /dev/null
}

dependency() { apt-cache depends "$1" 2> /dev/null | sed -n "s/^ *Depends: \($2\)\$/\1/p" | head -n 1; }

download() {
    image=$(dependency linux-image-amd64 'linux-image-.*')
    version=${image#linux-image-}
    headers=linux-headers-$version
    common=$(dependency "$headers" 'linux-headers-.*-common')
    kbuild=$(dependency "$headers" 'linux-kbuild-.*')
    [ -n "$image" ] && [ -n "$common" ] && [ -n "$kbuild" ] &&
        (cd "$guest/packages" && apt-get download -qq -o APT::Sandbox::User=root "$image" "$headers" "$common" "$kbuild" v4l2loopback-dkms)
}

renew_lists() {
    for _ in $(seq 60); do
        apt-get update -qq && return
        sleep 5
    done
    return 1
}

rm -rf "$guest"
mkdir -p "$guest/packages" "$guest/unpacked"
# Lists of packages may be absent, or name what is no longer to be had.
{ install_tools && download; } 2> "$guest/apt.log" || { renew_lists && install_tools && download; } || { cat "$guest/apt.log" >&2; exit 1; }
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
