//! From where a mesh is looked at: parallel projections along named directions, and where on the
//! picture a position comes to lie.

use glam::{DMat3, DVec3, Mat3A, Vec3A};

/// Steps between two samples of the picture: corners are rounded to them, so that neighbouring
/// triangles agree exactly on which of them covers a sample. As fine as graphics hardware has it.
pub(super) const STEPS_PER_SAMPLE: i32 = 256;

/// A direction to look from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// From the front.
    Front,
    /// From the right of one who stands in front.
    Right,
    /// From behind.
    Back,
    /// From the left of one who stands in front.
    Left,
    /// From above, the front towards the lower edge.
    Top,
    /// From below, the front towards the upper edge.
    Bottom,
    /// From the front, the right and above, all three foreshortened alike.
    Iso,
    /// From behind, the left and above.
    IsoBack,
}

/// The axis of the model that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// The first; the front looks along the third.
    X,
    /// The second; the front looks against the third, as modelling programs have it.
    Y,
    /// The third; the front looks along the second, as surveys and machines have it.
    Z,
}

impl View {
    /// All of them, in the order of a contact sheet.
    pub const ALL: [Self; 8] = [
        Self::Front,
        Self::Right,
        Self::Back,
        Self::Left,
        Self::Top,
        Self::Bottom,
        Self::Iso,
        Self::IsoBack,
    ];

    /// Its name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Right => "right",
            Self::Back => "back",
            Self::Left => "left",
            Self::Top => "top",
            Self::Bottom => "bottom",
            Self::Iso => "iso",
            Self::IsoBack => "iso-back",
        }
    }

    /// Takes model directions to those of the picture: to the right, down, and away from the
    /// viewer. A rotation, so what is left-handed in the model is so in the picture.
    pub(super) fn rotation(self, up: Up) -> DMat3 {
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
        // As seen from the front: to the right, up, and towards the viewer.
        let (right, up, near) = match up {
            Up::X => (y, x, -z),
            Up::Y => (x, y, z),
            Up::Z => (x, z, -y),
        };
        let (near, up) = match self {
            Self::Front => (near, up),
            Self::Right => (right, up),
            Self::Back => (-near, up),
            Self::Left => (-right, up),
            Self::Top => (up, -near),
            Self::Bottom => (-up, near),
            Self::Iso => (right + near + up, up),
            Self::IsoBack => (up - right - near, up),
        };
        let near = near.normalize();
        let right = up.cross(near).normalize();
        let up = near.cross(right);
        DMat3::from_cols(right, -up, -near).transpose()
    }
}

/// A rectangle of the picture, in samples or pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area {
    /// Columns to the left of it.
    pub left: usize,
    /// Rows above it.
    pub top: usize,
    /// Columns of it.
    pub width: usize,
    /// Rows of it.
    pub height: usize,
}

impl Area {
    /// The same with so many samples for each pixel along each side.
    pub(super) fn in_samples(self, per_pixel: usize) -> Self {
        Self {
            left: self.left * per_pixel,
            top: self.top * per_pixel,
            width: self.width * per_pixel,
            height: self.height * per_pixel,
        }
    }

    /// Whether a column and row are in it.
    pub(super) fn contains(self, [column, row]: [usize; 2]) -> bool {
        column.wrapping_sub(self.left) < self.width && row.wrapping_sub(self.top) < self.height
    }

    /// The sample that positions are counted from.
    pub(super) fn middle(self) -> [i32; 2] {
        [(self.left + self.width / 2) as i32, (self.top + self.height / 2) as i32]
    }
}

/// The box around a mesh along the directions of a view, in model units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extent {
    pub(super) min: DVec3,
    pub(super) max: DVec3,
}

impl Extent {
    pub(super) fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Steps per model unit with which it just fits `area` inside `margin` samples.
    pub(super) fn scale(&self, area: Area, margin: f64) -> f64 {
        let room = |samples: usize| (samples as f64 - 2.0 * margin).max(1.0);
        let wide = room(area.width) / self.size().x;
        let high = room(area.height) / self.size().y;
        // A single point has any scale; the finest meshes get one that single precision holds.
        let scale = wide.min(high) * f64::from(STEPS_PER_SAMPLE);
        if scale.is_finite() { scale.min(SCALE_MAX) } else { 1.0 }
    }
}

/// Greatest steps per model unit: products with the least positions stay in single precision.
const SCALE_MAX: f64 = 1e36;

/// Where positions come to lie in an area of the picture.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// Where it draws, in samples.
    pub(super) area: Area,
    /// What positions are taken relative to, before anything is rounded.
    centre: Vec3A,
    /// Rotation and scale: to steps to the right, down and away.
    matrix: Mat3A,
    /// Added at last: depths are positive.
    offset: Vec3A,
    rotation: DMat3,
    scale: f64,
    /// What comes to lie in the middle of the area, exactly, and how deep.
    middle: DVec3,
    depth: f64,
}

/// Corners farther than this from the middle of their area are drawn there: beyond it the sums that
/// round them would not hold. Areas are smaller.
const FAR: f32 = 4_194_000.0;
const LEAST: Vec3A = Vec3A::new(-FAR, -FAR, 0.0);
const MOST: Vec3A = Vec3A::new(FAR, FAR, f32::MAX);

impl Projection {
    /// A projection that shows `extent` in the middle of `area`.
    pub(super) fn new(rotation: DMat3, extent: &Extent, area: Area, scale: f64) -> Self {
        let middle = (extent.min + extent.max) / 2.0;
        let depth = extent.size().z / 2.0 * scale;
        Self::around(rotation.transpose() * middle, depth, (rotation, area, scale))
    }

    /// A projection that shows `middle` in the middle of its area, and at a depth.
    fn around(middle: DVec3, depth: f64, (rotation, area, scale): (DMat3, Area, f64)) -> Self {
        let centre = middle.as_vec3a();
        // What is lost by rounding the centre is made up for behind the rotation.
        let rest = rotation * (centre.as_dvec3() - middle);
        let half = |length: usize| f64::from((length % 2) as u32 * STEPS_PER_SAMPLE as u32) / 2.0;
        let offset = DVec3::new(half(area.width), half(area.height), depth + 1.0);
        let offset = (rest * scale + offset).as_vec3a();
        let matrix = Mat3A::from((rotation * scale).as_mat3());
        Self { area, centre, matrix, offset, rotation, scale, middle, depth }
    }

    /// The same for a mesh that lies `shift` from where its positions say.
    pub(super) fn shifted(&self, shift: DVec3) -> Self {
        Self::around(self.middle - shift, self.depth, (self.rotation, self.area, self.scale))
    }

    /// Steps to the right and down from the middle of the area, and away from the viewer.
    #[inline]
    pub(super) fn project(&self, position: [f32; 3]) -> Vec3A {
        let at = self.matrix * (Vec3A::from_array(position) - self.centre) + self.offset;
        at.max(LEAST).min(MOST)
    }

    /// The position that lies at `sample` of the whole picture at a depth.
    pub(super) fn position(&self, sample: [usize; 2], depth: f32) -> [f64; 3] {
        let middle = self.area.middle();
        let steps = |axis: usize| {
            let samples = sample[axis] as f64 - f64::from(middle[axis]) + 0.5;
            samples * f64::from(STEPS_PER_SAMPLE)
        };
        let at = DVec3::new(steps(0), steps(1), f64::from(depth)) - self.offset.as_dvec3();
        let position = self.rotation.transpose() * (at / self.scale) + self.centre.as_dvec3();
        position.to_array()
    }
}
