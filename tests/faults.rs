//! Whatever the disk does, a run ends with the right bytes or with an error that names a path, and
//! what it leaves can be resumed. `scripts/fault_test.py` makes every fault there is, over every
//! command; here is one of so many.

use std::{fs, process::Command};

use meshmill::formats::Format;

use crate::command::{Folder, Ran, Surface};

/// Small jobs that go to the disk, and what they make.
const JOBS: &[(&str, &str)] = &[
    ("sort in.stl -o out.soup --memory 1MiB", "out.soup"),
    ("simplify in.stl -o out.ply --cells 400 --memory 1MiB", "out.ply"),
    ("weld in.stl -o out.ply --memory 1MiB", "out.ply"),
];

/// Kinds of calls, and the first one that fails and the steps to the next.
const FAULTS: &[(&str, u64, u64)] = &[
    ("create", 2, 23),
    ("open", 3, 41),
    ("read", 5, 67),
    ("write", 7, 131),
    ("set-length", 1, 37),
    ("sync", 0, 5),
    ("rename", 0, 3),
    ("full", 50_000, 700_001),
];

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("in.stl", Surface::hills(110).shuffled().bytes(Format::Stl));
    fs::create_dir(folder.path("temp")).unwrap();
    folder
}

fn run(folder: &Folder, line: &str, fault: &str) -> Ran {
    let mut command: Command =
        folder.command(&format!("{line} --temp-dir temp --checkpoint-seconds 0"));
    command.env("MESHMILL_FAULT", fault).env("RUST_BACKTRACE", "0").output().unwrap().into()
}

/// Whether the command makes faults at all: one built for people does not.
fn makes_faults() -> bool {
    if cfg!(debug_assertions) {
        return true;
    }
    eprintln!("SKIPPED: faults are made by builds with debug assertions only");
    false
}

/// Runs the command without a fault, and keeps what it makes.
fn expect(folder: &Folder, line: &str, output: &str) {
    folder.done(line);
    fs::rename(folder.path(output), folder.path("expected")).unwrap();
}

/// Checks how a run with a fault ended, and goes on from what it left; `false` if it was done.
fn failed_well(folder: &Folder, line: &str, output: &str, ran: &Ran, what: &str) -> bool {
    let expected = folder.read("expected");
    if ran.code == Some(0) {
        assert!(folder.read(output) == expected, "{what}: other bytes");
        fs::remove_file(folder.path(output)).unwrap();
        return false;
    }
    assert_eq!(ran.code, Some(1), "{what}: {}", ran.stderr);
    assert!(ran.stderr.contains("meshmill: "), "{what}: {}", ran.stderr);
    let names = folder.names();
    let is_of_output = |name: &String| name == output || name.ends_with(".partial");
    assert!(!names.iter().any(is_of_output), "{what}: {names:?}");
    if fs::read_dir(folder.path("temp")).unwrap().count() > 0 {
        assert!(ran.stderr.contains("--resume"), "{what}: {}", ran.stderr);
        let again = run(folder, &format!("{line} --resume"), "short:1000000");
        assert_eq!(again.code, Some(0), "{what}, resumed: {}", again.stderr);
        assert!(folder.read(output) == expected, "{what}, resumed: other bytes");
        fs::remove_file(folder.path(output)).unwrap();
    }
    true
}

#[test]
fn whatever_the_disk_refuses_nothing_is_lost() {
    if !makes_faults() {
        return;
    }
    let folder = folder();
    for (line, output) in JOBS {
        expect(&folder, line, output);
        for (kind, first, step) in FAULTS {
            let mut n = *first;
            loop {
                let fault = format!("{kind}:{n}");
                let what = format!("{line}, {fault}");
                let ran = run(&folder, line, &fault);
                if !failed_well(&folder, line, output, &ran, &what) {
                    break;
                }
                n += step;
            }
        }
    }
}

#[test]
fn a_short_write_is_no_fault() {
    if !makes_faults() {
        return;
    }
    let folder = folder();
    let (line, output) = JOBS[0];
    expect(&folder, line, output);
    for n in 0..3 {
        let ran = run(&folder, line, &format!("short:{n}"));
        assert!(!failed_well(&folder, line, output, &ran, "short"), "{}", ran.stderr);
    }
}

#[test]
fn a_bit_that_is_wrong_in_a_temporary_file_is_found() {
    if !makes_faults() {
        return;
    }
    let folder = folder();
    for (line, output) in JOBS {
        expect(&folder, line, output);
        let mut found = 0;
        for n in (0..40).step_by(2).chain((40..400).step_by(57)) {
            let what = format!("{line}, flip:{n}");
            let ran = run(&folder, line, &format!("flip:{n}"));
            if failed_well(&folder, line, output, &ran, &what) {
                let is_named = ran.stderr.contains("temp/meshmill-");
                assert!(is_named, "{what}: {}", ran.stderr);
                found += 1;
            }
        }
        assert!(found > 0, "{line}: nothing was found");
    }
}
