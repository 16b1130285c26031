//! The first stage: users' inputs become a [`Source`] of triangles.
//!
//! Vertices of indexed meshes are read into a table, in memory if the budget allows. Faces and
//! soups stay where they are when they can be read again; what cannot (standard input, faces that
//! refer to vertices still to come) is set aside in the workspace.

mod journal;
mod table;

use std::sync::{Mutex, PoisonError};

pub use journal::{STEP, note, recall};
use table::TableBuilder;

use crate::{
    error::{Error, Fault, Position, Result},
    formats::{Batch, Content, Findings, MeshReader, Origin},
    geometry::{Bounds, MAXIMA_DEFAULT, Sample, Sampler},
    progress::{Amount, Meter, Monitor, StageId},
    soup::{
        FaceList, FaceWriter, Input, LiveReader, Minima, OpenInput, OrderMeter, Part, Scratch,
        Source, Taken, Triangle, Vertex, VertexTable, for_each_in_order,
    },
    storage::{RecordWriter, Workspace},
};

/// What later stages need to know before they begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Nothing: the triangles are used once, as they come.
    Triangles,
    /// Bounds, count and a sample of all of them, and then the triangles again.
    Survey,
    /// The same, and how far soups are from sorted.
    Order,
}

/// What import needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// What for.
    pub need: Need,
    /// Share of the memory budget that vertex tables may take, 0 to 1; beyond it they are files.
    pub table_share: f64,
}

/// What import did.
pub struct Outcome<V> {
    /// The triangles.
    pub source: Source<V>,
    /// What was learnt on the way.
    pub survey: Survey,
}

/// Facts about all inputs together.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// What all positions are relative to, in model units.
    pub origin: [f64; 3],
    /// Vertices of indexed inputs.
    pub vertices: u64,
    /// Faces and soup triangles, when known.
    pub records: Option<u64>,
    /// Box around all vertices, relative to the origin. Of soups only after [`Need::Survey`].
    pub bounds: Bounds,
    /// Some of the vertices. Of soups only after [`Need::Survey`].
    pub sample: Sample,
    /// Along each axis, how many triangles the worst one comes too late to be in the order of their
    /// least coordinates, see [`OrderMeter::displacement_max`]. Only after [`Need::Order`], and if
    /// all inputs are soups.
    pub displacement_max: Option<[u64; 3]>,
    /// Bytes set aside in the workspace because an input could not be read again.
    pub spooled_bytes: u64,
    /// A vertex table did not fit in memory.
    pub table_on_disk: bool,
}

impl Survey {
    /// Triangles, about: polygons are known only once they are read, but a closed mesh has two
    /// triangles for every vertex.
    #[must_use]
    pub fn triangles(&self) -> u64 {
        self.records.unwrap_or(self.vertices * 2)
    }
}

/// Reads what must be read before the triangles can be used.
///
/// # Errors
/// [`Error::Input`] when an input is not what it says or has no faces, [`Error::Io`] when it
/// cannot be read or the workspace is full, cancellation.
pub fn import<V: Vertex>(
    inputs: Vec<OpenInput>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let mut job = Job {
        config,
        workspace,
        monitor,
        origin: Origin::undecided(),
        survey: Survey::default(),
        look: Look::default(),
    };
    job.look.order = (config.need == Need::Order).then(|| OrderMeter::new(MAXIMA_DEFAULT));
    let mut source = Source { parts: Vec::new(), findings: Findings::default() };
    for input in inputs {
        let input = job.around_origin(input)?;
        let part = if input.reader.declared().indexed {
            job.import_indexed(input, &mut source.findings)?
        } else if config.need == Need::Triangles {
            job.defer_soup(input)?
        } else if input.input.is_repeatable() {
            job.survey_soup(input)?
        } else {
            job.spool_soup(input, &mut source.findings)?
        };
        source.parts.push(part);
    }
    let Job { mut survey, look, origin, .. } = job;
    survey.origin = origin.get();
    survey.records = source.records();
    survey.bounds = look.bounds;
    let soups = source.parts.iter().all(|part| !matches!(part, Part::Indexed { .. }));
    survey.displacement_max = look.order.filter(|_| soups).map(|order| order.displacement_max());
    survey.sample = Sampler::finish(look.samplers, look.vertices);
    Ok(Outcome { source, survey })
}

/// Bounds and sample under way.
#[derive(Default)]
struct Look {
    bounds: Bounds,
    samplers: Vec<Sampler>,
    /// With [`Need::Order`].
    order: Option<OrderMeter>,
    /// Distinct vertices, about: a soup has a vertex for every two triangles.
    vertices: u64,
}

/// An import under way.
struct Job<'a> {
    config: &'a Config,
    workspace: &'a Workspace,
    monitor: &'a Monitor<'a>,
    /// Decided by the first vertex of the first input, for all of them.
    origin: Origin,
    survey: Survey,
    look: Look,
}

impl Job<'_> {
    /// Reopens an input if another has decided the origin meanwhile.
    fn around_origin(&self, open: OpenInput) -> Result<OpenInput> {
        if !self.origin.is_decided() || open.reader.origin() == self.origin {
            return Ok(open);
        }
        Input { origin: self.origin, ..open.input }.open()
    }

    /// Notes the origin a reader has chosen. All positions of a job are relative to one.
    fn note_origin(&mut self, reader: &dyn MeshReader, input: &mut Input) -> Result<()> {
        let chosen = reader.origin();
        if self.origin.is_decided() && chosen.is_decided() && chosen.get() != self.origin.get() {
            let text = format!("{} lies around another origin; convert it alone", input.path);
            return Err(Error::Request(text));
        }
        if chosen.is_decided() {
            self.origin = chosen;
            input.origin = chosen;
        }
        Ok(())
    }

    /// Leaves a soup to be read when its triangles are used; one batch is read ahead, which
    /// decides the origin.
    fn defer_soup<V: Vertex>(&mut self, open: OpenInput) -> Result<Part<V>> {
        let OpenInput { mut input, mut reader, .. } = open;
        let records = reader.declared().faces;
        let mut ahead = Batch::default();
        let path = input.path.as_path().to_owned();
        if !reader.read_batch(&mut ahead).map_err(|error| error.in_file(&path))? {
            let fault = Fault::NoFaces { vertices: 0 };
            return Err(Error::Input { path, at: Position::default(), fault });
        }
        self.note_origin(reader.as_ref(), &mut input)?;
        Ok(Part::Soup(LiveReader::opened(input, reader, Some(ahead), records)))
    }

    /// Reads the vertices, and the faces unless they can be read later.
    fn import_indexed<V: Vertex>(
        &mut self,
        open: OpenInput,
        findings: &mut Findings,
    ) -> Result<Part<V>> {
        let OpenInput { mut input, mut reader, .. } = open;
        let declared = reader.declared().clone();
        let can_wait = declared.vertices_first
            && (input.is_repeatable() || self.config.need == Need::Triangles);
        let faces_now = if can_wait { Some(0) } else { declared.faces };
        let records = declared.vertices.zip(faces_now).map(|(vertices, faces)| vertices + faces);
        let meter = self.monitor.meter(StageId::Import, records);
        let mut table = TableBuilder::new(declared.vertices, self.config, self.workspace)?;
        let mut sampler = Sampler::default();
        let mut faces = None;
        let mut bad = false;
        let mut batch = Batch::default();
        let path = input.path.as_path().to_owned();
        while reader.read_batch(&mut batch).map_err(|error| error.in_file(&path))? {
            if !can_wait || batch.content == Content::Vertices {
                meter.add(batch.count() as u64)?;
            }
            if batch.content == Content::Vertices {
                table.make_room(batch.positions.len() as u64, self.workspace)?;
                let look = || {
                    sampler.look(batch.positions.iter().copied());
                    look_at(&batch.positions, &mut self.look.bounds)
                };
                // A thread that does nothing else would wait for the memory it is first to touch.
                let (is_bad, added) = rayon::join(look, || table.extend(&batch));
                added?;
                bad |= is_bad;
                continue;
            }
            if can_wait {
                self.note_origin(reader.as_ref(), &mut input)?;
                let vertices = self.finish_table(table, sampler)?;
                meter.finish();
                let live = LiveReader::opened(input, reader, Some(batch), declared.faces);
                let faces = FaceList::Input(live);
                return Ok(Part::Indexed { vertices, faces, has_bad_vertices: bad });
            }
            let writer = match &mut faces {
                Some(writer) => writer,
                none => none.insert(FaceWriter::create(self.workspace)?),
            };
            writer.write(&batch.faces)?;
        }
        meter.finish();
        self.note_origin(reader.as_ref(), &mut input)?;
        findings.merge(reader.findings());
        let fault = Fault::NoFaces { vertices: table.count };
        let Some(faces) = faces else {
            return Err(Error::Input { path, at: Position::default(), fault });
        };
        let faces = faces.finish()?;
        self.survey.spooled_bytes += faces.size_bytes();
        let vertices = self.finish_table(table, sampler)?;
        let faces = FaceList::Stored(faces);
        Ok(Part::Indexed { vertices, faces, has_bad_vertices: bad })
    }

    fn finish_table<V: Vertex>(
        &mut self,
        table: TableBuilder<V>,
        sampler: Sampler,
    ) -> Result<VertexTable<V>> {
        self.look.samplers.push(sampler);
        self.look.vertices += table.count;
        self.survey.vertices += table.count;
        let table = table.finish(self.workspace)?;
        self.survey.table_on_disk |= matches!(table, VertexTable::File { .. });
        Ok(table)
    }

    /// Reads a soup that will be read again, on all threads.
    fn survey_soup<V: Vertex>(&mut self, open: OpenInput) -> Result<Part<V>> {
        let input = open.input.clone();
        let amount = Amount { records: open.reader.declared().faces, bytes: input.size_bytes() };
        let meter = self.monitor.meter(StageId::Import, amount);
        let parts = vec![self.defer_soup::<V>(open)?];
        let input = Input { origin: self.origin, ..input };
        let source = Source { parts, findings: Findings::default() };
        let records = if let Some(mut order) = self.look.order.take() {
            let records = self.look_in_order(&source, &mut order, &meter)?;
            self.look.order = Some(order);
            records
        } else {
            self.look_in_any_order(&source, &meter)?
        };
        meter.finish();
        self.count_soup(&input, records)?;
        Ok(Part::Soup(LiveReader::closed(input, Some(records))))
    }

    /// Looks at a soup on all threads, at its order on this one; returns how many triangles it has.
    fn look_in_order<V: Vertex>(
        &mut self,
        source: &Source<V>,
        order: &mut OrderMeter,
        meter: &Meter,
    ) -> Result<u64> {
        let samplers = Mutex::new(Vec::<Sampler>::new());
        let lock = || samplers.lock().unwrap_or_else(PoisonError::into_inner);
        let work = |taken: &Taken<'_, V>, (minima, bounds): &mut (Minima, Bounds)| {
            let spare = lock().pop();
            let mut sampler = spare.unwrap_or_default();
            // All corners, as those of an indexed mesh: the sample is to be that of the surface.
            let corners = taken.triangles.iter().flat_map(|triangle| &triangle.0);
            sampler.look(corners.map(V::position));
            lock().push(sampler);
            minima.fill(taken.triangles, bounds);
        };
        let mut records = 0;
        for_each_in_order(source, meter, self.workspace.budget(), work, |(minima, bounds)| {
            order.add(minima);
            self.look.bounds = self.look.bounds.union(bounds);
            records += minima.count() as u64;
            Ok(())
        })?;
        self.look.samplers.append(&mut lock());
        Ok(records)
    }

    /// Looks at a soup on all threads; returns how many triangles it has.
    fn look_in_any_order<V: Vertex>(&mut self, source: &Source<V>, meter: &Meter) -> Result<u64> {
        let pass = source.pass();
        let looks = Mutex::new(Vec::new());
        let threads = self.workspace.budget().threads();
        rayon::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|_| {
                    let look = look_at_soup(&pass, meter);
                    looks.lock().unwrap_or_else(PoisonError::into_inner).push(look);
                });
            }
        });
        let mut records = 0;
        for look in looks.into_inner().unwrap_or_else(PoisonError::into_inner) {
            let (bounds, sampler, seen) = look?;
            self.look.bounds = self.look.bounds.union(&bounds);
            self.look.samplers.push(sampler);
            records += seen;
        }
        Ok(records)
    }

    /// Sets a soup aside in the workspace.
    fn spool_soup<V: Vertex>(
        &mut self,
        open: OpenInput,
        findings: &mut Findings,
    ) -> Result<Part<V>> {
        let (input, declared) = (open.input.clone(), open.reader.declared().faces);
        let meter = self.monitor.meter(StageId::Import, declared);
        let parts = vec![self.defer_soup::<V>(open)?];
        let source = Source { parts, findings: Findings::default() };
        let pass = source.pass();
        let mut writer = RecordWriter::create(self.workspace, "soup", declared)?;
        let (mut scratch, mut sampler) = (Scratch::default(), Sampler::default());
        let mut minima = Minima::default();
        while let Some(taken) = pass.next(&mut scratch)? {
            look_at_triangles(taken.triangles, &mut sampler, &mut self.look.bounds);
            if let Some(order) = &mut self.look.order {
                let corners = taken.triangles.iter().flat_map(|triangle| &triangle.0);
                sampler.look(corners.map(V::position));
                minima.fill(taken.triangles, &mut self.look.bounds);
                order.add(&minima);
            }
            writer.extend(taken.triangles)?;
            meter.add(taken.records)?;
        }
        meter.finish();
        findings.merge(&pass.finish());
        self.look.samplers.push(sampler);
        let file = writer.finish()?;
        self.survey.spooled_bytes += file.size_bytes();
        self.count_soup(&input, file.count())?;
        Ok(Part::Stored(file))
    }

    fn count_soup(&mut self, input: &Input, triangles: u64) -> Result<()> {
        if triangles == 0 {
            let path = input.path.as_path().to_owned();
            let fault = Fault::NoFaces { vertices: 0 };
            return Err(Error::Input { path, at: Position::default(), fault });
        }
        self.look.vertices += triangles.div_ceil(2);
        Ok(())
    }
}

/// Adds positions to `bounds`; tells whether one of them is not finite.
fn look_at(positions: &[[f32; 3]], bounds: &mut Bounds) -> bool {
    let mut bad = false;
    for position in positions {
        bounds.add(*position);
        bad |= !(position[0] + position[1] + position[2]).is_finite();
    }
    bad && positions.iter().any(|position| !position.iter().all(|c| c.is_finite()))
}

fn look_at_triangles<V: Vertex>(
    triangles: &[Triangle<V>],
    sampler: &mut Sampler,
    bounds: &mut Bounds,
) {
    sampler.look(triangles.iter().map(|triangle| triangle.0[0].position()));
    bounds.add_triangles(triangles.iter().map(|triangle| triangle.0.map(|v| v.position())));
}

/// One thread's share of a survey.
fn look_at_soup<V: Vertex>(
    pass: &crate::soup::Pass<'_, V>,
    meter: &Meter,
) -> Result<(Bounds, Sampler, u64)> {
    let (mut bounds, mut sampler, mut seen) = (Bounds::default(), Sampler::default(), 0);
    let mut scratch = Scratch::default();
    while let Some(taken) = pass.next(&mut scratch)? {
        look_at_triangles(taken.triangles, &mut sampler, &mut bounds);
        seen += taken.triangles.len() as u64;
        meter.add(taken.records)?;
    }
    Ok((bounds, sampler, seen))
}
