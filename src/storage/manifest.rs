//! What a workspace says of itself, so that a run can go on where another one died: the job it is
//! for, the steps that are done, and the files they made. docs/FORMATS.md describes the bytes.
//!
//! It only says. Which files there are, and whether they are as it says, is looked at elsewhere.

use std::{collections::BTreeMap, path::Path};

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A job as far as its result depends on it: names for a person, and values to compare.
pub type Fingerprint = BTreeMap<String, String>;

/// All that is known of a job under way.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The job.
    pub job: Fingerprint,
    /// What is done of it, by name.
    pub steps: BTreeMap<String, Step>,
}

/// A step that is finished, or a part of one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// What whoever does the step needs to know to go on. Numbers in it are integers.
    pub figures: Value,
    /// The files it made.
    pub files: Vec<FileEntry>,
}

/// A record file of the workspace.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Its name in the folder of the workspace, never with a folder in it.
    pub name: String,
    /// Records in it; in an unfinished one those that count.
    pub count: u64,
    /// Bytes of a record.
    pub record_bytes: u32,
    /// CRC-32 of those records.
    pub checksum: u32,
    /// Nothing will be appended: it has its header, and no byte more than it says.
    pub finished: bool,
}

/// Why bytes are no manifest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ManifestFault {
    /// It begins otherwise.
    #[error("not a manifest")]
    Foreign,
    /// It is of another version of this program.
    #[error("of another version")]
    Version,
    /// It is shorter or longer than it says.
    #[error("torn")]
    Torn,
    /// A bit is not as it was written.
    #[error("does not match its checksum")]
    Checksum,
    /// It matches its checksum, and makes no sense.
    #[error("not understood")]
    Content,
}

/// First word of a manifest.
const MAGIC: &str = "meshmill-manifest";
/// Version of the manifest and of what steps write into it: a workspace is resumed by the version
/// that made it, or not at all.
const VERSION: &str = concat!("1-", env!("CARGO_PKG_VERSION"));

impl Manifest {
    /// The bytes of the file: a line with magic, version, length and checksum, and JSON.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let json = serde_json::to_vec(self).expect("maps with text as keys become JSON");
        let checksum = crc32fast::hash(&json);
        let mut bytes = format!("{MAGIC} {VERSION} {} {checksum:08x}\n", json.len()).into_bytes();
        bytes.extend(json);
        bytes
    }

    /// Reads what [`Self::to_bytes`] wrote.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ManifestFault> {
        let end = bytes.iter().position(|byte| *byte == b'\n').ok_or(ManifestFault::Foreign)?;
        let (line, json) = (&bytes[..end], &bytes[end + 1..]);
        let line = std::str::from_utf8(line).map_err(|_| ManifestFault::Foreign)?;
        let mut words = line.split(' ');
        if words.next() != Some(MAGIC) {
            return Err(ManifestFault::Foreign);
        }
        if words.next() != Some(VERSION) {
            return Err(ManifestFault::Version);
        }
        if words.next() != Some(json.len().to_string().as_str()) {
            return Err(ManifestFault::Torn);
        }
        let checksum = format!("{:08x}", crc32fast::hash(json));
        if words.next() != Some(checksum.as_str()) || words.next().is_some() {
            return Err(ManifestFault::Checksum);
        }
        let manifest: Self = serde_json::from_slice(json).map_err(|_| ManifestFault::Content)?;
        let are_plain = manifest.files().all(FileEntry::is_plain);
        let are_exact = manifest.steps.values().all(|step| is_exact(&step.figures));
        if are_plain && are_exact { Ok(manifest) } else { Err(ManifestFault::Content) }
    }

    /// All files of all steps.
    pub fn files(&self) -> impl Iterator<Item = &FileEntry> {
        self.steps.values().flat_map(|step| &step.files)
    }

    /// What differs between the job of this manifest and another one, by name.
    #[must_use]
    pub fn differences(&self, other: &Fingerprint) -> Vec<String> {
        let names =
            self.job.keys().chain(other.keys().filter(|name| !self.job.contains_key(*name)));
        names.filter(|name| self.job.get(*name) != other.get(*name)).cloned().collect()
    }
}

/// Whether all numbers in it are integers: others do not come back bit by bit.
pub(super) fn is_exact(value: &Value) -> bool {
    match value {
        Value::Number(number) => !number.is_f64(),
        Value::Array(values) => values.iter().all(is_exact),
        Value::Object(fields) => fields.values().all(is_exact),
        Value::Null | Value::Bool(_) | Value::String(_) => true,
    }
}

impl FileEntry {
    /// Whether the name is that of a file in the folder itself, and no other file of ours.
    fn is_plain(&self) -> bool {
        let mut parts = Path::new(&self.name).components();
        let is_one = matches!(parts.next(), Some(std::path::Component::Normal(name)) if name == self.name.as_str());
        is_one && parts.next().is_none() && self.name.starts_with(|c: char| c.is_ascii_digit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest() -> Manifest {
        let entry = |name: &str, finished| FileEntry {
            name: name.to_owned(),
            count: 7,
            record_bytes: 36,
            checksum: 0xdead_beef,
            finished,
        };
        let files = vec![entry("00001-bucket", true), entry("00002-bucket", false)];
        let figures = serde_json::json!({ "held": u64::MAX, "keys": ["ff"] });
        let job = [("scan.stl: size".to_owned(), "84".to_owned())].into_iter().collect();
        Manifest {
            job,
            steps: [("sorted".to_owned(), Step { figures, files })].into_iter().collect(),
        }
    }

    #[test]
    fn what_is_written_is_read() {
        for manifest in [manifest(), Manifest::default()] {
            assert_eq!(Manifest::from_bytes(&manifest.to_bytes()), Ok(manifest));
        }
    }

    #[test]
    fn a_torn_manifest_is_none_wherever_it_is_torn() {
        let bytes = manifest().to_bytes();
        for length in 0..bytes.len() {
            assert!(Manifest::from_bytes(&bytes[..length]).is_err(), "{length} bytes");
        }
        let longer = [&bytes[..], b" "].concat();
        assert_eq!(Manifest::from_bytes(&longer), Err(ManifestFault::Torn));
    }

    #[test]
    fn every_flipped_bit_is_found() {
        let bytes = manifest().to_bytes();
        for bit in 0..bytes.len() * 8 {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(Manifest::from_bytes(&flipped).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn another_version_is_told_from_damage() {
        let text = String::from_utf8(manifest().to_bytes()).unwrap();
        let other = text.replacen(VERSION, "2-0.0.1", 1);
        assert_eq!(Manifest::from_bytes(other.as_bytes()), Err(ManifestFault::Version));
        assert_eq!(Manifest::from_bytes(b"ply\nformat"), Err(ManifestFault::Foreign));
    }

    #[test]
    fn a_name_that_leads_out_of_the_folder_is_refused() {
        for name in ["../00001-x", "/etc/passwd", "a/1", "", "lock", "manifest", "0/../../1", "1/"]
        {
            let mut bad = manifest();
            bad.steps.get_mut("sorted").unwrap().files[0].name = name.to_owned();
            assert_eq!(
                Manifest::from_bytes(&bad.to_bytes()),
                Err(ManifestFault::Content),
                "{name}"
            );
        }
    }

    #[test]
    fn what_differs_is_named() {
        let mut other = manifest().job;
        assert!(manifest().differences(&other).is_empty());
        other.insert("scan.stl: size".to_owned(), "85".to_owned());
        other.insert("--ratio".to_owned(), "0.5".to_owned());
        assert_eq!(manifest().differences(&other), ["scan.stl: size", "--ratio"]);
    }
}
