//! Disks that fill up, as far as this machine lets a test make one.

use std::{
    io::{self, Write as _},
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use meshmill::formats::Format;

use crate::command::{Folder, Surface};

/// A disk of one mebibyte, mounted until dropped.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None`, said aloud, where mounting is not allowed.
    fn mount(at: &Path) -> Option<Self> {
        std::fs::create_dir(at).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", "size=1m", "meshmill-test"]).arg(at);
        let mounted = mount.stderr(Stdio::null()).status();
        if mounted.is_ok_and(|status| status.success()) {
            return Some(Self(at.to_owned()));
        }
        writeln!(io::stderr(), "skipped: a small disk cannot be mounted here").unwrap();
        None
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        drop(Command::new("umount").arg(&self.0).status());
    }
}

#[test]
fn a_full_disk_is_1_names_the_place_and_leaves_nothing() {
    let folder = Folder::new();
    let Some(disk) = SmallDisk::mount(&folder.path("disk")) else { return };
    let surface = Surface::hills(180);
    for format in [Format::Ply, Format::Soup, Format::Stl] {
        folder.write(&format!("in.{}", format.name()), surface.bytes(format));
    }
    let soup = folder.read("in.soup");
    for (line, is_piped) in [
        // The output: known beforehand, found while writing, compressed, staged.
        ("soup in.ply -o disk/out.stl --temp-dir .", false),
        ("soup - --input-format soup -o disk/out.stl --temp-dir .", true),
        ("weld in.soup -o disk/out.ply --temp-dir .", false),
        ("simplify in.stl -o disk/out.ply --cells 2000 --temp-dir .", false),
        ("simplify in.stl -o disk/out.obj --cells 2000 --temp-dir .", false),
        ("generate sphere --triangles 40k -o disk/out.stl --temp-dir .", false),
        ("generate gyroid --triangles 70k -o disk/out.ply --temp-dir .", false),
        // Temporary files: a soup set aside, spilled sums, sorted corners, a staged output.
        ("simplify - --input-format soup -o out.ply -t 100 --temp-dir disk", true),
        ("simplify in.soup -o out.ply --cells 2000 --memory 1MiB --temp-dir disk", false),
        ("weld in.soup -o out.ply --memory 1MiB --temp-dir disk", false),
        ("weld - --input-format soup -o out.ply --memory 1MiB --temp-dir disk", true),
        ("generate sphere --triangles 40k -o out.stl.gz --temp-dir disk", false),
    ] {
        let before = folder.names();
        let ran = if is_piped { folder.run_with(line, &soup) } else { folder.run(line) };
        assert_eq!(ran.code, Some(1), "{line}: {}", ran.stderr);
        let named = ran.stderr.contains("disk/")
            || ran.stderr.contains("the folder for temporary files")
            || ran.stderr.contains("the output");
        assert!(named, "{line}: {}", ran.stderr);
        assert_eq!(folder.names(), before, "{line}");
        let left = std::fs::read_dir(&disk.0).unwrap().count();
        assert_eq!(left, 0, "{line}: {left} entries are left");
    }
}
