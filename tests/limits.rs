//! Every command, on inputs twenty times its memory, in a process that the system gives no more than
//! was promised.

use std::process::Command;

use crate::command::Folder;

/// What is promised beside `--memory`, and room for what is reserved and never used: the limit counts
/// addresses, such as the stacks of threads and vectors that have grown to twice what is in them.
const BESIDE_MIB: u64 = 64 + 16;

/// Runs a command line under a limit on its data; returns what it said if it failed.
fn fails_within(folder: &Folder, line: &str, memory_mib: u64) -> Option<String> {
    let force = if line.contains(" -o ") { "--force" } else { "" };
    let command = folder.command(&format!("{line} --memory {memory_mib}MiB -j 2 -q {force}"));
    let limit_kib = (memory_mib + BESIDE_MIB) << 10;
    let mut limited = Command::new("sh");
    limited.arg("-c").arg(format!("ulimit -d {limit_kib} && exec \"$0\" \"$@\""));
    limited.arg(command.get_program()).args(command.get_args());
    limited.current_dir(command.get_current_dir().expect("commands run in their folder"));
    let output = limited.output().expect("a shell is there");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (!output.status.success()).then(|| format!("{line} in {memory_mib} MiB: {said}"))
}

#[test]
fn no_command_takes_more_memory_than_was_promised() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 1600k -o in.ply");
    folder.done("soup in.ply -o in.stl");
    folder.done("simplify in.ply -o small.ply --ratio 1%");
    folder.scatter("in.stl", "scattered.stl");
    let failed: Vec<String> = [
        ("sort in.stl -o out.stl", 4),
        ("sort scattered.stl -o out.stl", 4),
        ("soup in.ply -o out.stl", 4),
        ("weld scattered.stl -o out.ply", 4),
        ("simplify in.ply -o out.ply --method cluster -t 400k", 4),
        ("simplify scattered.stl -o out.ply --method cluster -t 400k", 4),
        ("simplify in.stl -o out.ply --method hybrid --ratio 0.1%", 4),
        ("simplify scattered.stl -o out.ply --selection multiple-choice --ratio 1%", 24),
        ("simplify scattered.stl -o out.ply --method stream --ratio 1%", 72),
        ("info in.ply", 4),
        ("info scattered.stl --topology", 24),
        ("compare in.ply small.ply --samples 50k", 16),
        ("render in.stl -o out.png --size 640x480", 16),
    ]
    .into_iter()
    .filter_map(|(line, memory_mib)| fails_within(&folder, line, memory_mib))
    .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
