//! Kills at random moments, over every method. `scripts/kill_test.py` does more of them, on larger
//! meshes.

use super::*;

/// What is killed; OUT is replaced by what the output is called.
const METHODS: &[&str] = &[
    "simplify in.stl -o OUT.ply --ratio 5% --method stream --memory 64MiB",
    "simplify in.stl -o OUT.ply --ratio 20% --method stream --metric volume --memory 64MiB",
    "simplify in.stl -o OUT.ply --ratio 5% --selection multiple-choice --memory 2MiB",
    "simplify in.stl -o OUT.ply --cells 150 --memory 1MiB",
    "simplify in.ply -o OUT.ply --method cluster -t 700 --memory 2MiB",
    "simplify in.ply -o OUT.ply --method hybrid -t 900 --memory 4MiB",
    "simplify in.stl -o OUT.ply --max-error 0.5% --memory 48MiB",
    "sort in.stl -o OUT.soup --memory 1MiB",
    "soup in.ply -o OUT.stl --memory 1MiB",
    "weld in.stl -o OUT.ply --memory 1MiB",
];

/// Rounds of each method; more with `MESHMILL_KILL_ROUNDS`.
fn rounds() -> usize {
    std::env::var("MESHMILL_KILL_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1)
}

#[test]
fn runs_that_are_killed_at_random_end_with_the_same_bytes() {
    let seed = std::process::id().into();
    eprintln!("seed {seed}");
    let (folder, mut dice) = (folder(380), Dice(seed));
    for method in METHODS {
        let started = Instant::now();
        folder.done(&method.replace("OUT", "expected"));
        let seconds = started.elapsed().mul_f32(1.5);
        let output = method.split("OUT").nth(1).unwrap().split(' ').next().unwrap();
        let [expected, output] = ["expected", "out"].map(|name| format!("{name}{output}"));
        let line = format!("{} {DENSE}", method.replace("OUT", "out"));
        let mut kills = 0;
        for _ in 0..rounds() {
            kills += until_done(&folder, &line, &output, seconds, &mut dice);
            assert!(folder.read(&output) == folder.read(&expected), "{line}");
            fs::remove_file(folder.path(&output)).unwrap();
        }
        fs::remove_file(folder.path(&expected)).unwrap();
        eprintln!("{kills} kills: {method}");
    }
}

/// Runs a command and kills it, again and again, until it is done; returns how often.
fn until_done(
    folder: &Folder,
    line: &str,
    output: &str,
    seconds: Duration,
    dice: &mut Dice,
) -> usize {
    let mut kills = 0;
    loop {
        let resume = if kills > 0 { " --resume" } else { "" };
        let mut child = folder.command(&format!("{line}{resume}"));
        child.stdout(Stdio::null());
        let mut child = child.stderr(Stdio::piped()).spawn().unwrap();
        // Of those that go on, half are let alone.
        if kills == 0 || dice.below(2) == 0 {
            thread::sleep(seconds.mul_f32(dice.share()));
            child.kill().unwrap();
        }
        let ran: Ran = child.wait_with_output().unwrap().into();
        if ran.code.is_none() {
            kills += 1;
            if !folder.path(output).exists() {
                continue;
            }
        } else {
            assert_eq!(ran.code, Some(0), "{line}{resume}: {}", ran.stderr);
        }
        for name in workspaces(folder) {
            // Killed before the first checkpoint, or while it removed its folder.
            fs::remove_dir_all(folder.path("temp").join(name)).unwrap();
        }
        return kills;
    }
}
