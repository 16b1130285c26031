//! An import in the journal of its workspace: what was learnt, and what was set aside.
//!
//! Inputs that can be read again are, where that is all that import did. What cannot be read again
//! and was not set aside ends the journal: nobody could go on from it.

use serde::{Deserialize, Serialize};

use super::{
    Config, Look, Outcome, Survey,
    table::{RESIDENT_BYTES_MIN, RESIDENT_SHARE},
};
use crate::{
    error::Result,
    formats::{Findings, Origin},
    geometry::{Bounds, Sample},
    progress::Monitor,
    soup::{FaceList, Input, LiveReader, Part, Point, Source, StoredFaces, Vertex, VertexTable},
    storage::{FileEntry, Kept, Recalled, RecordFile, RecordWriter, Workspace},
};

/// What an import is called.
pub const STEP: &str = "import";

/// What is noted of an import. Its files are the sample, and then those of each part.
#[derive(Serialize, Deserialize)]
struct Figures {
    survey: SurveyFigures,
    findings: Findings,
    parts: Vec<PartFigures>,
}

#[derive(Serialize, Deserialize)]
enum PartFigures {
    /// A soup that is read again.
    Soup { records: Option<u64> },
    /// A soup that was set aside: one file.
    Stored,
    /// An indexed mesh: a file of the vertices, if there is one, and one of the faces.
    Indexed { vertices_stored: bool, faces: FaceFigures, has_bad_vertices: bool },
}

#[derive(Serialize, Deserialize)]
enum FaceFigures {
    Input { records: Option<u64> },
    Stored { faces: u64 },
}

/// A [`Survey`], floating-point numbers by their bits.
#[derive(Serialize, Deserialize)]
struct SurveyFigures {
    origin: [u64; 3],
    vertices: u64,
    records: Option<u64>,
    bounds: [[u32; 3]; 2],
    sample_vertices: u64,
    sample_distinct: u64,
    displacement_max: Option<[u64; 3]>,
    spooled_bytes: u64,
    table_on_disk: bool,
}

/// Notes an import, if it set something aside or took long.
///
/// # Errors
/// A full disk.
pub fn note<V: Vertex>(
    outcome: &Outcome<V>,
    inputs: &[Input],
    workspace: &Workspace,
) -> Result<()> {
    if !workspace.is_journaled() {
        return Ok(());
    }
    let parts = || outcome.source.parts.iter().zip(inputs);
    if !parts().all(|(part, input)| input.is_repeatable() || !reads_input(part)) {
        workspace.close_journal();
        return Ok(());
    }
    if !parts().any(|(part, _)| has_files(part)) && workspace.due().is_none() {
        return Ok(());
    }
    let mut sample = RecordWriter::<Point>::create(workspace, "sample", None)?;
    outcome.survey.sample.points.iter().try_for_each(|point| sample.push(&Point(*point)))?;
    let mut files = vec![sample.finish()?.kept()];
    let mut figures = Vec::new();
    for (part, input) in parts() {
        figures.push(note_part(part, input, &mut files, workspace)?);
    }
    let figures = Figures {
        survey: SurveyFigures::of(&outcome.survey),
        findings: outcome.source.findings.clone(),
        parts: figures,
    };
    workspace.note(STEP, &figures, files)
}

/// Whether a part is read from the user's input.
fn reads_input<V: Vertex>(part: &Part<V>) -> bool {
    matches!(part, Part::Soup(_) | Part::Indexed { faces: FaceList::Input(_), .. })
}

fn has_files<V: Vertex>(part: &Part<V>) -> bool {
    match part {
        Part::Soup(_) => false,
        Part::Stored(_) => true,
        Part::Indexed { vertices, faces, .. } => {
            matches!(vertices, VertexTable::File { .. }) || matches!(faces, FaceList::Stored(_))
        }
    }
}

fn note_part<V: Vertex>(
    part: &Part<V>,
    input: &Input,
    files: &mut Vec<Kept>,
    workspace: &Workspace,
) -> Result<PartFigures> {
    let (vertices, faces, has_bad_vertices) = match part {
        Part::Soup(reader) => return Ok(PartFigures::Soup { records: reader.records }),
        Part::Stored(file) => {
            files.push(file.kept());
            return Ok(PartFigures::Stored);
        }
        Part::Indexed { vertices, faces, has_bad_vertices } => (vertices, faces, *has_bad_vertices),
    };
    let is_read_again = matches!(faces, FaceList::Input(_)) && input.is_repeatable();
    let vertices_stored = match vertices {
        VertexTable::File { records, .. } => {
            files.push(records.file().kept());
            true
        }
        // They come before the faces, and are as quick to read there as from a file of ours.
        VertexTable::Memory(..) if is_read_again => false,
        VertexTable::Memory(vertices, _) => {
            let count = Some(vertices.len() as u64);
            let mut writer = RecordWriter::create(workspace, "vertices", count)?;
            writer.extend(vertices)?;
            files.push(writer.finish()?.kept());
            true
        }
    };
    let faces = match faces {
        FaceList::Input(reader) => FaceFigures::Input { records: reader.records },
        FaceList::Stored(faces) => {
            files.push(faces.file().kept());
            FaceFigures::Stored { faces: faces.count() }
        }
    };
    Ok(PartFigures::Indexed { vertices_stored, faces, has_bad_vertices })
}

/// The import that is noted, if one is: made of what was set aside, and of the inputs where that is
/// all there is.
///
/// # Errors
/// What reading them fails with.
pub fn recall<V: Vertex>(
    inputs: &[Input],
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Option<Outcome<V>>> {
    let Some(recalled) = workspace.recall::<Figures>(STEP) else { return Ok(None) };
    let Recalled { figures: Figures { survey, findings, parts }, files } = recalled;
    let mut files = files.iter();
    let mut next = || files.next().expect("as many files as were noted");
    let points = RecordFile::<Point>::adopt(workspace, next())?.read_all()?;
    let survey = survey.with_sample(points.into_iter().map(|point| point.0).collect());
    let origin = Origin::at(survey.origin);
    let mut source = Source { parts: Vec::new(), findings };
    for (part, input) in parts.into_iter().zip(inputs) {
        let input = Input { origin, ..input.clone() };
        let room = (config, workspace);
        source.parts.push(match part {
            PartFigures::Soup { records } => Part::Soup(LiveReader::closed(input, records)),
            PartFigures::Stored => Part::Stored(RecordFile::adopt(workspace, next())?),
            PartFigures::Indexed { vertices_stored: false, .. } => {
                read_again(&input, room, monitor)?
            }
            PartFigures::Indexed { faces, has_bad_vertices, .. } => {
                let vertices = table_of(next(), room)?;
                let faces = match faces {
                    FaceFigures::Input { records } => {
                        FaceList::Input(LiveReader::closed(input, records))
                    }
                    FaceFigures::Stored { faces } => {
                        let corners = RecordFile::adopt(workspace, next())?;
                        FaceList::Stored(StoredFaces::of_file(corners, faces))
                    }
                };
                Part::Indexed { vertices, faces, has_bad_vertices }
            }
        });
    }
    Ok(Some(Outcome { source, survey }))
}

/// An indexed input whose vertices are read into a table anew; what there is to learn of it is known.
fn read_again<V: Vertex>(
    input: &Input,
    (config, workspace): (&Config, &Workspace),
    monitor: &Monitor,
) -> Result<Part<V>> {
    let open = input.open()?;
    let (origin, survey, look) = (input.origin, Survey::default(), Look::default());
    let mut job = super::Job { config, workspace, monitor, origin, survey, look };
    job.import_indexed(open, &mut Findings::default())
}

/// Vertices that were written to a file: in memory again if they fit there.
fn table_of<V: Vertex>(
    entry: &FileEntry,
    (config, workspace): (&Config, &Workspace),
) -> Result<VertexTable<V>> {
    let file = RecordFile::<V>::adopt(workspace, entry)?;
    let (budget, bytes) = (workspace.budget(), file.count() * size_of::<V>() as u64);
    let share = (budget.available_bytes() as f64 * config.table_share) as u64;
    if let Some(room) = budget.reserve(bytes).filter(|_| bytes <= share) {
        return Ok(VertexTable::Memory(file.read_all()?, room));
    }
    // Nobody will see the contents of a map in whole.
    file.verify()?;
    let share = budget.available_bytes() as f64 * RESIDENT_SHARE;
    let resident_bytes_max = (share as u64).max(RESIDENT_BYTES_MIN);
    Ok(VertexTable::File { records: file.map()?, resident_bytes_max })
}

impl SurveyFigures {
    fn of(survey: &Survey) -> Self {
        Self {
            origin: survey.origin.map(f64::to_bits),
            vertices: survey.vertices,
            records: survey.records,
            bounds: [survey.bounds.min, survey.bounds.max].map(|corner| corner.map(f32::to_bits)),
            sample_vertices: survey.sample.vertices,
            sample_distinct: survey.sample.distinct,
            displacement_max: survey.displacement_max,
            spooled_bytes: survey.spooled_bytes,
            table_on_disk: survey.table_on_disk,
        }
    }

    fn with_sample(self, points: Vec<[f32; 3]>) -> Survey {
        let [min, max] = self.bounds.map(|corner| corner.map(f32::from_bits));
        Survey {
            origin: self.origin.map(f64::from_bits),
            vertices: self.vertices,
            records: self.records,
            bounds: Bounds { min, max },
            sample: Sample {
                points,
                vertices: self.sample_vertices,
                distinct: self.sample_distinct,
            },
            displacement_max: self.displacement_max,
            spooled_bytes: self.spooled_bytes,
            table_on_disk: self.table_on_disk,
        }
    }
}
