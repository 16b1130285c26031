//! The steps of a picture: measured, drawn, lit.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicU64, Ordering},
};

use glam::DVec3;

use super::{
    camera::{Projection, STEPS_PER_SAMPLE, Up, View},
    drawing::{Drawing, Paint},
    extent::Extents,
    frame::Frame,
    layout,
    picture::{Picture, Text},
    raster::{self, Style},
};
use crate::{
    error::{Error, Result},
    formats::Findings,
    progress::{Monitor, StageId},
    soup::{Scratch, Source, Taken, Vertex},
    storage::Budget,
};

/// What render needs to know.
#[derive(Clone, Debug)]
pub struct Config {
    /// From where; several views share the picture. At least one.
    pub views: Vec<View>,
    /// The axis that points up.
    pub up: Up,
    /// Pixels of the whole picture.
    pub size: Size,
    /// Samples along each side of a pixel, 1 to [`SAMPLES_MAX`]: more are smoother, and take their
    /// square in memory.
    pub samples: usize,
    /// Whether edges are drawn.
    pub edges: Edges,
}

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// What becomes of the edges of triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edges {
    /// They are not drawn.
    Hidden,
    /// They are drawn as far as they are visible.
    Drawn,
}

/// Most samples along a side of a picture: corners are rounded in single precision.
pub const SIDE_SAMPLES_MAX: usize = 1 << 14;
/// Most samples along a side of a pixel.
pub const SAMPLES_MAX: usize = 4;

/// What render made.
pub struct Outcome {
    /// The picture.
    pub picture: Picture,
    /// Triangles drawn, seen or not.
    pub triangles: u64,
    /// What the pass found.
    pub findings: Findings,
}

/// From where what is seen, decided before anything is drawn.
#[derive(Clone, Debug)]
pub struct Scene {
    /// One for each view.
    pub panels: Vec<Projection>,
    /// Pixels of the whole picture.
    pub size: Size,
    /// Samples along each side of a pixel.
    pub samples: usize,
    edges: Edges,
}

/// Bytes a picture takes while it is made: its samples, depths and pixels.
#[must_use]
pub fn memory_bytes(size: Size, samples: usize) -> u64 {
    let [width, height] = [size.width as u64, size.height as u64];
    let frame_bytes = Frame::memory_bytes(width * samples as u64, height * samples as u64);
    frame_bytes.saturating_add(width.saturating_mul(height).saturating_mul(PIXEL_BYTES))
}

/// A depth and a colour.
const PIXEL_BYTES: u64 = 4 + 3;

/// Draws a picture of `source`: a pass over it, and one before if it is a soup. Its memory is
/// [`memory_bytes`]; reserving that is up to the caller.
///
/// The picture does not depend on the order of triangles, nor on the number of threads.
///
/// # Errors
/// What reading the source fails with, [`Error::Request`] when it has no triangles, cancellation.
pub fn render<V: Vertex>(
    source: &Source<V>,
    config: &Config,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Outcome> {
    let Some(extents) = Extents::measure(source, config, budget, monitor)? else {
        return Err(Error::Request("there is nothing to be seen: no triangles".to_owned()));
    };
    let drawing = draw(source, &Scene::new(&extents, config), budget, monitor)?;
    let paint = if V::COLORED { Paint::Vertices } else { Paint::Plaster };
    let mut picture = drawing.picture(&paint);
    if config.views.len() > 1 {
        name_panels(config, &mut picture);
    }
    Ok(Outcome { picture, triangles: drawing.triangles, findings: drawing.findings })
}

/// Triangles between two looks at the flag that stops a job: each may fill the picture.
const TRIANGLES_PER_CHUNK: usize = 256;

/// Draws `source` into a scene, in one pass.
///
/// # Errors
/// What reading the source fails with, cancellation.
pub fn draw<V: Vertex>(
    source: &Source<V>,
    scene: &Scene,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Drawing> {
    let side = |pixels: usize| pixels * scene.samples;
    let frame = Frame::new(side(scene.size.width), side(scene.size.height));
    let edge = (scene.edges == Edges::Drawn).then(|| scene.edge_half_width());
    let style = Style { edge };
    let drawn = AtomicU64::new(0);
    let findings = for_each_batch(source, StageId::Render, (budget, monitor), |taken| {
        for triangles in taken.triangles.chunks(TRIANGLES_PER_CHUNK) {
            monitor.check(StageId::Render)?;
            for projection in &scene.panels {
                raster::draw(triangles, projection, style, &frame);
            }
        }
        drawn.fetch_add(taken.triangles.len() as u64, Ordering::Relaxed);
        Ok(())
    })?;
    let (triangles, scene) = (drawn.into_inner(), scene.clone());
    Ok(Drawing { frame, scene, triangles, findings })
}

/// Room around a mesh, relative to the shorter side of its panel.
const MARGIN: f64 = 0.04;

impl Scene {
    /// Places the cameras of `config` so that all views show the mesh in one scale.
    #[must_use]
    pub fn new(extents: &Extents, config: &Config) -> Self {
        assert!(!config.views.is_empty() && (1..=SAMPLES_MAX).contains(&config.samples));
        let Size { width, height } = config.size;
        assert!(width.max(height) * config.samples <= SIDE_SAMPLES_MAX && width.min(height) > 0);
        let areas: Vec<_> = layout::panels(config.views.len(), width, height)
            .into_iter()
            .map(|area| area.in_samples(config.samples))
            .collect();
        let fit = extents.by_view().zip(&areas).map(|((_, extent), area)| {
            extent.scale(*area, MARGIN * area.width.min(area.height) as f64)
        });
        let scale = fit.fold(f64::INFINITY, f64::min);
        let panels = extents.by_view().zip(&areas);
        let panels = panels
            .map(|((rotation, extent), area)| Projection::new(*rotation, extent, *area, scale))
            .collect();
        Self { panels, size: config.size, samples: config.samples, edges: config.edges }
    }

    /// The same scene for a mesh that lies `shift` from where its positions say.
    #[must_use]
    pub fn shifted(mut self, shift: DVec3) -> Self {
        for panel in &mut self.panels {
            *panel = panel.shifted(shift);
        }
        self
    }

    /// Half of what edges are wide, in steps: a pixel, and more in large pictures.
    fn edge_half_width(&self) -> f32 {
        let pixels = (self.size.width.min(self.size.height) as f32 / 1200.0).max(1.0);
        pixels * 0.5 * (self.samples as i32 * STEPS_PER_SAMPLE) as f32
    }
}

/// Letters of the names of views.
const NAME_COLOR: [u8; 3] = [96, 100, 110];

/// Writes the name of each view in its panel.
fn name_panels(config: &Config, picture: &mut Picture) {
    let Size { width, height } = config.size;
    for (view, area) in config.views.iter().zip(layout::panels(config.views.len(), width, height)) {
        let dot = (area.width.min(area.height) / 200).max(1);
        let text = Text { text: view.name(), color: NAME_COLOR, dot };
        let left = area.left + (area.width.saturating_sub(text.width())) / 2;
        let top = area.top + area.height.saturating_sub(2 * text.height());
        picture.write(left, top, text);
    }
}

/// Hands each batch of a source to `work`, on all threads that the memory has room for.
pub(super) fn for_each_batch<V: Vertex>(
    source: &Source<V>,
    stage: StageId,
    (budget, monitor): (&Budget, &Monitor),
    work: impl Fn(&Taken<'_, V>) -> Result<()> + Sync,
) -> Result<Findings> {
    let meter = monitor.meter(stage, source.amount());
    let pass = source.pass();
    let failed = Mutex::new(None);
    let on_a_thread = || -> Result<()> {
        let mut scratch = Scratch::default();
        while let Some(taken) = pass.next(&mut scratch)? {
            work(&taken)?;
            meter.add(taken.records)?;
        }
        Ok(())
    };
    rayon::scope(|scope| {
        for _ in 0..budget.threads() {
            scope.spawn(|_| {
                if let Err(error) = on_a_thread() {
                    *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                }
            });
        }
    });
    if let Some(error) = failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    meter.finish();
    Ok(pass.finish())
}
