//! Colours and normals as further bounds `[CKS98 §8]`: what a removed vertex looked like, beside the
//! face it is to hang at.
//!
//! Colours are compared, and interpolated over a face, in CIELAB; normals with the face's own.

use glam::{DVec3, Vec3};

use super::super::{Color, Mesh};
use super::hanging::ByDeviation;

/// Bounds on attributes, where there are any.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// How far the colour of a removed vertex may be from the one at the nearest point of its face:
    /// the distance in CIELAB, ΔE of 1976. Colours do not change.
    pub color: Option<f32>,
    /// How far the normal of a removed vertex, the mean of its faces' by area, may be from the face's,
    /// in radians.
    pub normal: Option<f32>,
}

/// What limits look at, by vertex, those removed as well; empty where there is no limit.
#[derive(Default)]
pub(super) struct Attributes {
    limits: Limits,
    colors: Vec<Vec3>,
    normals: Vec<Vec3>,
    /// Cosine of the limit.
    cosine: f32,
}

/// A face as limits see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    pub(super) corners: [u32; 3],
    /// Shares of the corners at the place that is looked at.
    pub(super) shares: [f64; 3],
    /// Of any length.
    pub(super) normal: DVec3,
}

/// Rounding in single precision is below this, in radians and in units of ΔE. Limits are smaller by as
/// much, but not below it.
const MARGIN: f32 = 1e-3;

impl Attributes {
    pub(super) fn of(mesh: &Mesh<ByDeviation>, limits: Limits) -> Self {
        let mut attributes = Self { limits, ..Self::default() };
        if limits.color.is_some() {
            attributes.colors = mesh.colors.iter().map(lab_of).collect();
        }
        if let Some(angle) = limits.normal {
            attributes.normals = mesh.normals.iter().map(|n| n.normalize_or_zero()).collect();
            attributes.cosine = (angle - MARGIN).max(MARGIN).cos();
        }
        attributes
    }

    /// Whether there is anything to look at.
    #[inline]
    pub(super) fn are_limited(&self) -> bool {
        !self.colors.is_empty() || !self.normals.is_empty()
    }

    /// Whether a removed vertex looks like a place of a face, as far as that matters.
    pub(super) fn allow(&self, vertex: u32, look: &Look) -> bool {
        self.allow_color(vertex, look) && self.allow_normal(vertex, look)
    }

    fn allow_color(&self, vertex: u32, look: &Look) -> bool {
        let (Some(limit), Some(color)) = (self.limits.color, self.colors.get(vertex as usize))
        else {
            return true;
        };
        let corners = look.corners.map(|corner| self.colors[corner as usize]);
        let [a, b, c] = look.shares.map(|share| share as f32);
        let mixed = corners[0] * a + corners[1] * b + corners[2] * c;
        let distance = mixed.distance(*color);
        // What has no colour is like any other.
        distance.is_nan() || distance <= (limit - MARGIN).max(MARGIN)
    }

    fn allow_normal(&self, vertex: u32, look: &Look) -> bool {
        let Some(normal) = self.normals.get(vertex as usize) else { return true };
        let length = look.normal.length();
        let along = look.normal.dot(normal.as_dvec3());
        // What has no direction is like any other.
        *normal == Vec3::ZERO || length == 0.0 || along >= f64::from(self.cosine) * length
    }
}

/// A colour in CIELAB, for a white of D65; not a number without any.
fn lab_of(color: &Color) -> Vec3 {
    if color.weight <= 0.0 {
        return Vec3::NAN;
    }
    let [r, g, b, _] = color.mean().map(|channel| linear(f32::from(channel) / 255.0));
    // IEC 61966-2-1, each row over the white's coordinate.
    let x = 0.433_953 * r + 0.376_219 * g + 0.189_828 * b;
    let y = 0.212_671 * r + 0.715_160 * g + 0.072_169 * b;
    let z = 0.017_758 * r + 0.109_477 * g + 0.872_765 * b;
    let [x, y, z] = [x, y, z].map(lightness);
    Vec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// A channel of sRGB as an amount of light.
fn linear(channel: f32) -> f32 {
    if channel <= 0.040_45 { channel / 12.92 } else { ((channel + 0.055) / 1.055).powf(2.4) }
}

fn lightness(share: f32) -> f32 {
    const KNEE: f32 = 216.0 / 24389.0;
    const SLOPE: f32 = 24389.0 / 27.0;
    if share > KNEE { share.cbrt() } else { (SLOPE * share + 16.0) / 116.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_where_the_tables_have_them() {
        // Of the sRGB primaries, by B. Lindbloom's calculator.
        for (rgb, expected) in [
            ([255.0, 255.0, 255.0], [100.0, 0.0, 0.0]),
            ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
            ([255.0, 0.0, 0.0], [53.24, 80.09, 67.20]),
            ([0.0, 255.0, 0.0], [87.73, -86.18, 83.18]),
            ([0.0, 0.0, 255.0], [32.30, 79.19, -107.86]),
            ([119.0, 119.0, 119.0], [50.03, 0.0, 0.0]),
        ] {
            let [r, g, b] = rgb;
            let found = lab_of(&Color { rgba: [r, g, b, 255.0], weight: 1.0 });
            assert!(found.distance(Vec3::from_array(expected)) < 0.1, "{rgb:?}: {found}");
        }
    }
}
