//! Axis-aligned bounding boxes.

use glam::DVec3;

/// The smallest axis-aligned box around some points; empty when `min > max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinate per axis.
    pub min: [f32; 3],
    /// Largest coordinate per axis.
    pub max: [f32; 3],
}

impl Default for Bounds {
    fn default() -> Self {
        Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] }
    }
}

impl Bounds {
    /// Grows to hold `point`; coordinates that are NaN are ignored.
    pub fn add(&mut self, point: [f32; 3]) {
        for (axis, coordinate) in point.into_iter().enumerate() {
            self.min[axis] = self.min[axis].min(coordinate);
            self.max[axis] = self.max[axis].max(coordinate);
        }
    }

    /// The box around both.
    #[must_use]
    pub fn union(mut self, other: &Self) -> Self {
        if !other.is_empty() {
            self.add(other.min);
            self.add(other.max);
        }
        self
    }

    /// Whether no point was added.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.min[axis] > self.max[axis])
    }

    /// Edge lengths; zero when empty.
    #[must_use]
    pub fn size(&self) -> DVec3 {
        if self.is_empty() {
            return DVec3::ZERO;
        }
        DVec3::from_array(self.max.map(f64::from)) - DVec3::from_array(self.min.map(f64::from))
    }

    /// The axis along which the box is longest: 0, 1 or 2; the first of equals.
    #[must_use]
    pub fn longest_axis(&self) -> usize {
        let size = self.size();
        (1..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest })
    }

    /// Length of the diagonal; zero when empty.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        self.size().length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_grows_with_its_points_and_ignores_nan() {
        let mut bounds = Bounds::default();
        assert!(bounds.is_empty() && bounds.diagonal() == 0.0);
        bounds.add([1.0, 2.0, 3.0]);
        bounds.add([4.0, f32::NAN, 3.0]);
        assert_eq!((bounds.min, bounds.max), ([1.0, 2.0, 3.0], [4.0, 2.0, 3.0]));
        assert_eq!(bounds.union(&Bounds::default()), bounds);
    }

    #[test]
    fn the_longest_axis_is_the_first_of_equals() {
        let longest = |max| Bounds { min: [0.0; 3], max }.longest_axis();
        assert_eq!(
            [longest([1.0, 2.0, 3.0]), longest([1.0, 2.0, 2.0]), longest([2.0; 3])],
            [2, 1, 0]
        );
        assert_eq!(Bounds::default().longest_axis(), 0);
    }
}
