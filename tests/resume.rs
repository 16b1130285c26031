//! Runs that die, and go on: the bytes of a run that nobody disturbed, nothing under the output's
//! name before, and a word to the person about what is kept and what is skipped.

use std::{
    fs, io,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use meshmill::formats::Format;

use crate::command::{Dice, Folder, Ran, Surface};

mod kills;

/// A folder with meshes in no order, and one for temporary files.
fn folder(side: u64) -> Folder {
    let (folder, surface) = (Folder::new(), Surface::hills(side).shuffled());
    folder.write("in.stl", surface.bytes(Format::Stl));
    folder.write("in.ply", surface.bytes(Format::Ply));
    fs::create_dir(folder.path("temp")).unwrap();
    folder
}

/// Every checkpoint there can be is made.
const DENSE: &str = "--temp-dir temp --checkpoint-seconds 0";

/// The workspaces in the folder for temporary files.
fn workspaces(folder: &Folder) -> Vec<String> {
    let entries = fs::read_dir(folder.path("temp")).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Runs a command until something is kept of it, and kills it; `false` if it was done before.
fn killed(folder: &Folder, line: &str) -> bool {
    let mut child =
        folder.command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(60) {
        let is_kept = |name: &String| folder.path("temp").join(name).join("manifest").exists();
        if workspaces(folder).iter().any(is_kept) {
            break;
        }
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    !child.wait().unwrap().success()
}

const SORT: &str = "sort in.stl -o out.soup --memory 1MiB";

#[test]
fn a_killed_run_goes_on_and_says_from_where() {
    let folder = folder(150);
    folder.done(&format!("{SORT} --temp-dir temp"));
    let expected = folder.read("out.soup");
    fs::remove_file(folder.path("out.soup")).unwrap();
    assert!(killed(&folder, &format!("{SORT} {DENSE}")));
    assert!(!folder.path("out.soup").exists());
    let left = workspaces(&folder);
    assert_eq!(left.len(), 1);
    let ran = folder.run(&format!("{SORT} {DENSE} --resume"));
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(
        ran.stderr.contains("going on from") && ran.stderr.contains(&left[0]),
        "{}",
        ran.stderr
    );
    assert!(folder.read("out.soup") == expected);
    assert!(workspaces(&folder).is_empty(), "a finished run leaves nothing");
}

#[test]
fn memory_and_threads_may_differ() {
    let folder = folder(150);
    folder.done(&format!("{SORT} --temp-dir temp -j 3"));
    let expected = folder.read("out.soup");
    for more in ["--memory 64MiB -j 1", "--memory 1100KiB -j 3"] {
        fs::remove_file(folder.path("out.soup")).unwrap();
        assert!(killed(&folder, &format!("{SORT} {DENSE}")));
        let line = format!("{} {more} {DENSE} --resume", SORT.replace("--memory 1MiB", ""));
        let ran = folder.run(&line);
        assert!(ran.stderr.contains("going on from"), "{line}: {}", ran.stderr);
        assert!(folder.read("out.soup") == expected, "{line}");
    }
}

#[test]
fn what_lies_there_is_not_touched_unless_asked_for() {
    let folder = folder(150);
    assert!(killed(&folder, &format!("{SORT} {DENSE}")));
    let left = workspaces(&folder);
    let ran = folder.run(&format!("{SORT} --temp-dir temp"));
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stderr.contains("--resume") && ran.stderr.contains(&left[0]), "{}", ran.stderr);
    assert_eq!(workspaces(&folder), left);
}

#[test]
fn nothing_to_resume_is_said_and_no_fault() {
    let folder = folder(20);
    let ran = folder.run("sort in.stl -o out.soup --resume --temp-dir temp");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stderr.contains("nothing to resume"), "{}", ran.stderr);
}

#[test]
fn another_job_is_refused_and_what_differs_named() {
    let folder = folder(150);
    assert!(killed(&folder, &format!("{SORT} {DENSE}")));
    let left = workspaces(&folder);
    for (line, word) in [
        (format!("{SORT} {DENSE} --resume --axis y"), "axis"),
        (format!("{} {DENSE} --resume", SORT.replace("in.stl", "in.ply")), "inputs"),
        (format!("{SORT} {DENSE} --resume --on-defect skip"), "on defect"),
        (format!("{} {DENSE} --resume", SORT.replace("sort", "soup")), "command"),
    ] {
        let said = folder.fails(&line, 2);
        assert!(said.contains("cannot be resumed") && said.contains(word), "{line}: {said}");
    }
    let mut bytes = folder.read("in.stl");
    let last = bytes.len() - 3;
    bytes[last] ^= 1;
    folder.write("in.stl", bytes);
    let said = folder.fails(&format!("{SORT} {DENSE} --resume"), 2);
    assert!(said.contains("in.stl: last bytes"), "{said}");
    assert_eq!(workspaces(&folder), left);
}

#[test]
fn two_runs_for_one_output_are_one_too_many() {
    let folder = folder(20);
    let fifo = folder.path("pipe");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    let line = "sort in.stl -o out.soup --temp-dir temp";
    let mut first = waiting(&folder, "simplify pipe --input-format stl -o out.soup --cells 9");
    let said = folder.fails(line, 2);
    assert!(said.contains("out.soup is being made by another run"), "{said}");
    folder.done("sort in.stl -o other.soup --temp-dir temp");
    first.kill().unwrap();
    first.wait().unwrap();
    folder.done(line);
}

/// A run that has its workspace and waits for a pipe.
fn waiting(folder: &Folder, line: &str) -> Child {
    let mut command = folder.command(&format!("{line} --temp-dir temp"));
    let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let pipe = fs::OpenOptions::new().write(true).read(true).open(folder.path("pipe")).unwrap();
    // More than is read before there is a workspace, and less than all.
    let mut bytes = vec![0; 80];
    bytes.extend(1_000_000_u32.to_le_bytes());
    bytes.resize(1 << 20, 0);
    thread::spawn(move || {
        io::Write::write_all(&mut &pipe, &bytes).unwrap();
        // Held open for as long as the test lasts.
        thread::sleep(Duration::from_secs(600));
    });
    while !workspaces(folder).iter().any(|name| !name.contains(".new")) {
        thread::sleep(Duration::from_millis(1));
    }
    child
}

#[test]
fn a_finished_run_leaves_its_files_if_told_to() {
    let folder = folder(150);
    folder.done(&format!("{SORT} {DENSE} --keep-temp"));
    assert_eq!(workspaces(&folder).len(), 1);
    let ran = folder.run(&format!("{SORT} {DENSE} --resume --force"));
    assert!(ran.stderr.contains("going on from"), "{}", ran.stderr);
    assert!(workspaces(&folder).is_empty());
}

#[test]
fn a_signal_keeps_what_is_done_and_says_how_to_go_on() {
    let folder = folder(150);
    let mut child = folder.command(&format!("{SORT} {DENSE}"));
    let child = child.stderr(Stdio::piped()).spawn().unwrap();
    while workspaces(&folder).is_empty() {
        thread::sleep(Duration::from_millis(1));
    }
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let ran: Ran = child.wait_with_output().unwrap().into();
    if ran.code == Some(130) && !workspaces(&folder).is_empty() {
        assert!(ran.stderr.contains("with --resume goes on from it"), "{}", ran.stderr);
    }
    assert!(matches!(ran.code, Some(130 | 0)), "{}", ran.stderr);
}

#[test]
fn a_run_that_fails_early_leaves_nothing() {
    let folder = folder(150);
    let said = folder.fails(
        &format!("{} --temp-dir temp", SORT.replace("out.soup", "/dev/full --output-format soup")),
        1,
    );
    assert!(said.contains("/dev/full") && !said.contains("--resume"), "{said}");
    assert!(workspaces(&folder).is_empty());
}

#[test]
fn a_spooled_pipe_is_not_read_again() {
    let folder = folder(150);
    let line = "simplify - --input-format stl -o out.ply --cells 60 --memory 1MiB";
    let bytes = folder.read("in.stl");
    assert_eq!(folder.run_with(line, &bytes).code, Some(0));
    let expected = folder.read("out.ply");
    fs::remove_file(folder.path("out.ply")).unwrap();
    let ran = folder.run_with(&format!("{line} {DENSE} --keep-temp"), &bytes);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    fs::remove_file(folder.path("out.ply")).unwrap();
    // Standard input is empty.
    let ran = folder.run(&format!("{line} {DENSE} --resume"));
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stderr.contains("import"), "{}", ran.stderr);
    assert!(folder.read("out.ply") == expected);
}

#[test]
fn the_method_stays_as_it_was_chosen() {
    let folder = folder(150);
    let line = "simplify in.stl -o out.ply --ratio 5%";
    let memory = "--memory 64MiB";
    folder.done(&format!("{line} {memory} {DENSE} --keep-temp"));
    let expected = folder.read("out.ply");
    // So little that clustering would be chosen.
    let ran = folder.run(&format!("{line} --memory 16MiB {DENSE} --resume --force"));
    if ran.code == Some(0) {
        assert!(folder.read("out.ply") == expected, "{}", ran.stderr);
    } else {
        assert!(ran.stderr.contains("allow more --memory"), "{}", ran.stderr);
    }
}
