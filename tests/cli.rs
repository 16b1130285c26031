//! The contract of the command line: exit codes, what is said, and that nothing is left behind.

use std::{
    fs,
    io::{self, Read as _, Write as _},
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use meshmill::formats::Format;

use crate::command::{Folder, Surface};

mod disk;
mod inputs;

/// A folder with a mesh in two formats.
fn folder() -> Folder {
    let (folder, surface) = (Folder::new(), Surface::hills(20));
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.write("in.stl", surface.bytes(Format::Stl));
    folder
}

#[test]
fn misuse_is_2_and_touches_nothing() {
    let folder = folder();
    let (ply, stl) = (folder.read("in.ply"), folder.read("in.stl"));
    for (line, word) in [
        ("soup in.ply -o in.stl", "replace it with --force"),
        ("simplify in.ply -o in.ply --cells 9", "is an input"),
        ("simplify in.ply -o ./in.ply --cells 9 --force", "is an input"),
        ("soup in.ply -o out.xyz", "say --output-format"),
        ("soup in.ply -o out", "say --output-format"),
        ("soup in.ply -o out.ply", "indexed"),
        ("weld in.stl -o out.stl", "no indices"),
        ("soup in.ply -o -", "say --output-format"),
        ("soup in.ply -o out.off", "not written"),
        ("soup in.ply - -o out.stl", "the only input"),
        ("soup in.ply -o out.stl --input-format xyz", "one of"),
        ("simplify in.ply -o out.ply", "--ratio"),
        ("simplify in.ply -o out.ply --ratio 2", "above 0 and at most 1"),
        ("simplify in.ply -o out.ply -t 5 --cells 5", "cannot be used"),
        ("soup in.ply -o out.stl --report in.ply", "cannot be the report"),
        ("soup in.ply -o out.stl --report out.stl", "cannot be the report"),
        ("generate sphere --triangles 100 -o in.ply", "replace it with --force"),
        ("polish in.ply", "unrecognized"),
    ] {
        let said = folder.fails(line, 2);
        assert!(said.contains(word), "{line}: {said}");
    }
    assert!(folder.read("in.ply") == ply && folder.read("in.stl") == stl);
}

#[test]
fn what_the_system_refuses_is_1_and_named() {
    let folder = folder();
    fs::create_dir(folder.path("folder")).unwrap();
    for (line, word) in [
        ("soup nothing.ply -o out.stl", "nothing.ply"),
        ("soup in.ply -o no/such/out.stl", "no/such"),
        ("soup in.ply -o out.stl --temp-dir no/folder", "no/folder"),
        ("soup in.ply -o out.stl --temp-dir in.stl", "in.stl"),
        ("soup in.ply -o folder --force --output-format stl", "folder"),
        ("soup in.ply -o out.stl --report no/such/report", "no/such"),
        ("simplify in.ply -o out.ply --cells 9 --memory 1000", "allow more --memory"),
        ("soup in.ply -o /dev/full --output-format stl", "/dev/full"),
        ("simplify in.ply -o /dev/full --output-format ply --cells 9", "/dev/full"),
        ("generate sphere --triangles 9k -o /dev/full --output-format stl", "/dev/full"),
    ] {
        let said = folder.fails(line, 1);
        assert!(said.contains(word), "{line}: {said}");
    }
    assert_eq!(fs::read_dir(folder.path("folder")).unwrap().count(), 0);
}

#[test]
fn devices_and_pipes_are_written_to_and_stay() {
    use std::os::unix::fs::FileTypeExt as _;
    let folder = folder();
    for (job, format) in [("soup", "stl"), ("weld", "ply"), ("simplify --cells 9", "stl")] {
        folder.done(&format!("{job} in.ply -o /dev/null --output-format {format}"));
        folder.done(&format!("{job} in.ply -o /dev/null --output-format {format} --force"));
    }
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    assert!(Command::new("mkfifo").arg(folder.path("pipe")).status().unwrap().success());
    folder.done("soup in.ply -o expected.stl");
    let ran = thread::scope(|scope| {
        let read = scope.spawn(|| fs::read(folder.path("pipe")).unwrap());
        let ran = folder.run("soup in.ply -o pipe --output-format stl");
        assert!(read.join().unwrap() == folder.read("expected.stl"));
        ran
    });
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    // And read from: a pipe is an input that can be read once.
    let bytes = folder.read("in.stl");
    thread::scope(|scope| {
        scope.spawn(|| fs::write(folder.path("pipe"), &bytes).unwrap());
        folder.done("simplify pipe --input-format stl -o piped.ply --cells 9");
    });
    folder.done("simplify in.stl -o direct.ply --cells 9");
    assert!(folder.read("piped.ply") == folder.read("direct.ply"));
    assert!(fs::metadata(folder.path("pipe")).unwrap().file_type().is_fifo());
}

#[test]
fn standard_output_can_be_named_as_a_file() {
    let folder = folder();
    let ran = folder.run("soup in.ply -o /dev/stdout --output-format stl -q");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    folder.done("soup in.ply -o expected.stl");
    assert!(ran.stdout.starts_with(&folder.read("expected.stl")));
}

#[test]
fn counts_of_a_stream_that_nothing_can_hold_are_3() {
    let folder = Folder::new();
    for (vertices, faces) in [(u64::MAX, 1), (4, 1_u64 << 62), (1 << 45, 1 << 45)] {
        let header = format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\nelement face {faces}\nproperty list uchar int vertex_indices\n\
             end_header\n0 0 0\n"
        );
        for line in ["simplify - -o out.ply --ratio 1%", "sort - -o out.stl", "soup - -o out.stl"] {
            let ran = folder.run_with(&format!("{line} --input-format ply"), header.as_bytes());
            assert_eq!(ran.code, Some(3), "{line}, {vertices}: {}", ran.stderr);
            assert!(ran.stderr.contains("at most 17592186044416"), "{line}: {}", ran.stderr);
        }
    }
}

#[test]
fn a_dry_run_prints_the_plan_and_writes_nothing() {
    let folder = folder();
    let before = folder.names();
    for line in
        ["simplify in.ply -o out.ply -t 100", "soup in.ply -o out.stl", "weld in.stl -o o.ply"]
    {
        let plan = String::from_utf8(folder.done(&format!("{line} --dry-run"))).unwrap();
        for word in ["export", "memory", "temporary", "output", "time"] {
            assert!(plan.contains(word), "{line}: {plan}");
        }
        assert_eq!(folder.names(), before, "{line}");
    }
    // What cannot be done is known before it is begun.
    folder.fails("simplify in.ply -o in.stl -t 100 --dry-run", 2);
    folder.fails("soup nothing.ply -o out.stl --dry-run", 1);
}

#[test]
fn a_report_has_the_fields_that_scripts_rely_on() {
    let folder = folder();
    folder.write(
        "bad.ply",
        String::from_utf8_lossy(
            b"ply\nformat ascii 1.0\nelement vertex 4\n\
        property float x\nproperty float y\nproperty float z\nproperty float quality\n\
        element face 2\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 1\n1 0 0 1\n0 1 0 1\n1 1 0 1\n3 0 1 2\n3 1 3 9\n",
        )
        .as_bytes(),
    );
    let report = folder.report("simplify in.ply -o out.ply -t 300 --memory 64MiB");
    let top = [
        "input",
        "output",
        "reached_target",
        "stopped_by",
        "peak_memory_bytes",
        "temporary_bytes_peak",
        "estimates",
        "seconds",
        "stages",
        "dropped",
        "defects",
    ];
    for field in top {
        assert!(report.get(field).is_some(), "{field}: {report}");
    }
    assert_eq!(report["input"]["triangles"], 800);
    assert_eq!(report["input"]["vertices"], 441);
    assert_eq!(report["input"]["bounds"]["min"][0], 0.0);
    assert_eq!(report["output"]["bytes"], folder.read("out.ply").len());
    for field in ["triangles", "vertices"] {
        assert!(report["output"][field].as_u64().unwrap() > 0, "{report}");
    }
    assert!(report["peak_memory_bytes"].as_u64().unwrap() < 128 << 20);
    for stage in report["stages"].as_array().unwrap() {
        for field in ["name", "seconds", "records"] {
            assert!(stage.get(field).is_some(), "{stage}");
        }
    }
    let report = folder.report("soup bad.ply -o out.stl --on-defect skip");
    assert_eq!(report["defects"][0]["count"], 1);
    assert!(report["dropped"][0].as_str().unwrap().contains("quality"), "{report}");
    assert_eq!(report["output"]["vertices"], serde_json::Value::Null);
    let report = folder.report("generate gyroid --triangles 2k -o made.ply");
    assert_eq!(report["output"]["bytes"], folder.read("made.ply").len());
}

#[test]
fn a_result_is_measured_against_its_input() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 20k -o in.ply");
    let line = "simplify in.ply -o out.ply --ratio 10% --samples 20k";
    let report = folder.report(&format!("{line} --measure"));
    let compared = folder.done("compare in.ply out.ply --samples 20k --json");
    let compared: serde_json::Value = serde_json::from_slice(&compared).unwrap();
    assert_eq!(report["deviation"], compared);
    assert!(compared["max"].as_f64().unwrap() > 0.0, "{compared}");
    // Several inputs are one mesh, in their own format.
    folder.done("soup in.ply -o half.stl");
    std::fs::rename(folder.path("half.stl"), folder.path("half.bin")).unwrap();
    let line = "simplify half.bin half.bin --input-format stl -o twice.obj --ratio 10% --measure";
    let ran = folder.run(&format!("{line} --samples 5k --report report.json"));
    let told = String::from_utf8(ran.stdout).unwrap();
    assert!(ran.code == Some(0) && told.contains("away from the input"), "{told} {}", ran.stderr);
    let report: serde_json::Value = serde_json::from_slice(&folder.read("report.json")).unwrap();
    assert_eq!(report["deviation"]["a"]["path"], "half.bin and 1 more");
    let said = folder.fails("simplify in.ply -o - --output-format soup --ratio 10% --measure", 2);
    assert!(said.contains("pipe"), "{said}");
}

#[test]
fn quiet_is_silent_and_otherwise_progress_is_plain_lines() {
    let folder = folder();
    for line in [
        "simplify in.ply -o a.ply --cells 9",
        "soup in.ply -o b.stl",
        "generate sphere --triangles 99 -o c.stl",
    ] {
        let ran = folder.run(&format!("{line} -q"));
        assert_eq!(
            (ran.code, ran.stderr.as_str(), ran.stdout),
            (Some(0), "", Vec::new()),
            "{line}"
        );
        let ran = folder.run(&format!("{line} --force"));
        assert!(ran.stderr.contains("export") || ran.stderr.contains("generate"), "{}", ran.stderr);
        assert!(!ran.stderr.contains('\x1b') && !ran.stderr.contains('\r'), "{}", ran.stderr);
        let ran = folder.run(&format!("{line} --force --progress json"));
        for line in ran.stderr.lines() {
            serde_json::from_str::<serde_json::Value>(line).unwrap();
        }
    }
}

#[test]
fn help_names_every_flag_of_the_contract() {
    let folder = Folder::new();
    let running =
        ["--memory", "--threads", "--temp-dir", "--report", "--progress", "--quiet", "--verbose"];
    let convert =
        ["--input-format", "--on-defect", "--output", "--output-format", "--force", "--dry-run"];
    let simplify = [
        "--ratio",
        "--target-faces",
        "--cells",
        "--cell-size",
        "--method",
        "--placement",
        "--boundary-weight",
        "--strict",
    ];
    let generate = ["--triangles", "--noise", "--seed", "--output", "--output-format", "--force"];
    for (command, flags) in [
        ("simplify", [&running[..], &convert, &simplify].concat()),
        ("soup", [&running[..], &convert].concat()),
        ("sort", [&running[..], &convert, &["--axis"]].concat()),
        ("weld", [&running[..], &convert].concat()),
        ("generate", [&running[..], &generate].concat()),
    ] {
        let help = String::from_utf8(folder.done(&format!("{command} --help"))).unwrap();
        for flag in flags {
            assert!(help.contains(flag), "{command} {flag}: {help}");
        }
    }
    let help = String::from_utf8(folder.done("--help")).unwrap();
    assert!(
        ["simplify", "soup", "sort", "weld", "generate", "Exit codes"]
            .iter()
            .all(|word| help.contains(word))
    );
}

/// Starts a run that waits for more of its standard input, in a folder of its own for temporary
/// files, and waits until it works.
fn waiting(folder: &Folder, line: &str) -> Child {
    let mut command = folder.command(line);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let soup = Surface::hills(80).bytes(Format::Soup);
    // All but the end.
    child.stdin.as_mut().unwrap().write_all(&soup[..soup.len() / 2]).unwrap();
    let is_at_work = || folder.names().iter().any(|name| name.starts_with("meshmill-"));
    while !is_at_work() && child.try_wait().unwrap().is_none() {
        thread::sleep(Duration::from_millis(5));
    }
    child
}

#[test]
fn a_signal_ends_a_run_and_leaves_nothing() {
    let folder = folder();
    let before = folder.names();
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let mut child = waiting(&folder, "simplify - --input-format soup -o out.ply --cells 30");
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
        // Another thread may read the little that is left before the one that takes signals runs.
        let status = format!("/proc/{id}/status");
        let is_pending = || {
            let status = std::fs::read_to_string(&status).unwrap_or_default();
            let mut masks = status
                .lines()
                .filter_map(|line| line.strip_prefix("SigPnd:").or(line.strip_prefix("ShdPnd:")));
            masks.any(|mask| mask.trim().bytes().any(|digit| digit != b'0'))
        };
        while is_pending() {
            thread::sleep(Duration::from_millis(5));
        }
        thread::sleep(Duration::from_millis(50));
        // What comes now is not worked on any more.
        let rest = Surface::hills(80).bytes(Format::Soup);
        let mut stdin = child.stdin.take().unwrap();
        drop(stdin.write_all(&rest[rest.len() / 2..]));
        drop(stdin);
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(code), "{said}");
        assert!(said.contains("cancelled during"), "{said}");
        assert_eq!(folder.names(), before, "nothing is left");
    }
}

#[test]
fn nobody_hears_of_a_closed_pipe() {
    let folder = folder();
    let before = folder.names();
    for (line, code) in [
        ("generate sphere --triangles 300k -o - --output-format soup", 1),
        ("simplify in.ply -o - --output-format ply --cells 2000", 1),
        ("soup in.ply -o b.stl", 0),
    ] {
        let mut command = folder.command(&format!("{line} -j 1"));
        let (reader, writer) = io::pipe().unwrap();
        drop(reader);
        let output = command.stdout(writer).stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        assert!(!said.contains("panicked") && !said.contains("meshmill:"), "{line}: {said}");
    }
    assert_eq!(folder.names().len(), before.len() + 1, "{:?}", folder.names());
}
