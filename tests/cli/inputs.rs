//! Inputs that are not what they say: exit code 3, a place, and nothing left.

use std::fs;

use meshmill::formats::Format;

use crate::command::{Folder, Surface};

/// Jobs on one input, each of which must notice.
const JOBS: &[&str] = &[
    "soup IN -o out.stl",
    "weld IN -o out.ply",
    "simplify IN -o out.ply --cells 9",
    "simplify IN -o out.ply -t 50 --memory 1MiB --method cluster",
    "simplify IN -o out.ply -t 50 --memory 64MiB",
    "soup IN -o out.soup.gz --memory 1MiB",
];

/// Runs every job on `bytes` as a file and through a pipe; all must fail with 3 and `word`.
fn refused(name: &str, bytes: &[u8], word: &str) {
    let folder = Folder::new();
    folder.write(name, bytes);
    let format = name.rsplit('.').next().unwrap();
    for job in JOBS {
        let said = folder.fails(&job.replace("IN", name), 3);
        assert!(said.contains(word) && said.contains(name), "{name}, {job}: {said}");
        let line = job.replace("IN", &format!("- --input-format {format}"));
        let ran = folder.run_with(&line, bytes);
        assert_eq!(ran.code, Some(3), "{line}: {}", ran.stderr);
        assert_eq!(folder.names(), [name], "{line}");
    }
}

#[test]
fn a_truncated_input_is_noticed_wherever_it_ends() {
    let surface = Surface::hills(20);
    for format in [Format::Ply, Format::Stl, Format::Soup] {
        let bytes = surface.bytes(format);
        for length in [60, 150, bytes.len() / 3, bytes.len() * 3 / 4, bytes.len() - 1] {
            // The first bytes of an STL may be anything: a name.
            if format != Format::Stl || length > 84 {
                refused(&format!("in.{}", format.name()), &bytes[..length], "");
            }
        }
    }
}

#[test]
fn counts_that_lie_are_noticed() {
    let surface = Surface::hills(20);
    let mut stl = surface.bytes(Format::Stl);
    stl[80..84].copy_from_slice(&900_u32.to_le_bytes());
    refused("more.stl", &stl, "");
    let ply = surface.bytes(Format::Ply);
    for (from, to) in
        [("vertex 441", "vertex 440"), ("face 800", "face 801"), ("face 800", "face 8000")]
    {
        refused("lie.ply", &replaced(&ply, from, to), "");
    }
}

fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

#[test]
fn what_is_no_mesh_is_noticed() {
    refused("empty.ply", b"", "empty");
    refused("empty.stl", b"", "empty");
    let utf16: Vec<u8> =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    refused("wide.obj", &[&[0xff, 0xfe], &utf16[..]].concat(), "UTF-16");
    refused("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces");
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
        property float z\nend_header\n0 0 0\n";
    refused("points.ply", points.as_bytes(), "no faces");
    let mut none = vec![0; 84];
    none[..5].copy_from_slice(b"empty");
    refused("none.stl", &none, "no faces");
}

#[test]
fn a_folder_is_no_input() {
    let folder = Folder::new();
    fs::create_dir(folder.path("folder.ply")).unwrap();
    for job in JOBS {
        folder.fails(&job.replace("IN", "folder.ply"), 3);
    }
}

#[test]
fn bad_records_stop_a_run_or_are_left_out() {
    let bad_index = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 9\n".as_slice();
    let not_a_number = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\n".as_slice();
    let mut stl = Surface::hills(1).bytes(Format::Stl);
    stl[84 + 12..84 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    for (name, bytes) in [("index.obj", bad_index), ("nan.obj", not_a_number), ("nan.stl", &stl)] {
        refused(name, bytes, "--on-defect skip");
        let folder = Folder::new();
        folder.write(name, bytes);
        for (job, output) in [("soup", "o.stl"), ("weld", "o.ply"), ("simplify --cells 5", "s.ply")]
        {
            let report = folder.report(&format!("{job} {name} -o {output} --on-defect skip"));
            assert_eq!(report["output"]["triangles"], 1, "{name} {job}: {report}");
            // A vertex that is bad, and a face for its sake, are two.
            let count = report["defects"][0]["count"].as_u64().unwrap();
            assert!((1..=2).contains(&count), "{name} {job}: {report}");
            let ran = folder.run(&format!("{job} {name} -o {output} --on-defect skip --force"));
            assert!(ran.stderr.contains("defect: "), "{}", ran.stderr);
        }
        // All of it bad: then there is no mesh.
        let all = replaced_all(bytes, name);
        folder.write(name, &all);
        for job in JOBS {
            let ran = folder.run(&format!("{} --force --on-defect skip", job.replace("IN", name)));
            assert_eq!(ran.code, Some(3), "{name} {job}: {}", ran.stderr);
        }
    }
}

/// The file with its good face or triangle gone.
fn replaced_all(bytes: &[u8], name: &str) -> Vec<u8> {
    if name == "nan.stl" {
        let mut all = bytes.to_vec();
        all[84 + 62..84 + 66].copy_from_slice(&f32::NAN.to_le_bytes());
        return all;
    }
    replaced(bytes, "f 1 2 3\n", "")
}
