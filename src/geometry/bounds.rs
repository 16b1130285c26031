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

    /// Grows to hold triangles. As [`Self::add`] does, but many numbers at a time.
    pub fn add_triangles(&mut self, triangles: impl Iterator<Item = [[f32; 3]; 3]>) {
        // One box for each corner, so that no comparison waits for the last one.
        let (mut min, mut max) = ([self.min; 3], [self.max; 3]);
        for triangle in triangles {
            let (min, max) = (min.as_flattened_mut(), max.as_flattened_mut());
            for ((min, max), coordinate) in min.iter_mut().zip(max).zip(triangle.as_flattened()) {
                // Unlike `f32::min`, an instruction: NaN is never less.
                *min = if *coordinate < *min { *coordinate } else { *min };
                *max = if *coordinate > *max { *coordinate } else { *max };
            }
        }
        for axis in 0..3 {
            self.min[axis] = min.iter().fold(self.min[axis], |least, min| least.min(min[axis]));
            self.max[axis] = max.iter().fold(self.max[axis], |most, max| most.max(max[axis]));
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

    /// The smallest box of single precision around a point of double precision.
    #[inline]
    #[must_use]
    pub fn around(point: [f64; 3]) -> Self {
        let below =
            |c: f64| if f64::from(c as f32) > c { (c as f32).next_down() } else { c as f32 };
        let above = |c: f64| if f64::from(c as f32) < c { (c as f32).next_up() } else { c as f32 };
        Self { min: point.map(below), max: point.map(above) }
    }

    /// The square of the gap between two boxes that are not empty, 0 where they meet. Rounded:
    /// what is compared with it is made a little larger, see [`reach_sq`].
    #[inline]
    #[must_use]
    pub fn gap_sq(&self, other: &Self) -> f32 {
        let mut sum = 0.0;
        for axis in 0..3 {
            let gap = greater(self.min[axis] - other.max[axis], other.min[axis] - self.max[axis]);
            let gap = greater(gap, 0.0);
            sum += gap * gap;
        }
        sum
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

/// The greater of two numbers; unlike `f32::max`, an instruction.
#[inline]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// How far rounding can take [`Bounds::gap_sq`] above the truth, with room to spare.
const GAP_SLACK: f64 = 1.0 + 1e-6;

/// The square of a distance as [`Bounds::gap_sq`] may be compared with it: what is in a box cannot
/// be nearer than `distance_sq` when the gap to the box is greater than this. Infinite gaps are not
/// greater than an infinite reach, so boxes too far apart for single precision are still looked at.
#[inline]
#[must_use]
pub fn reach_sq(distance_sq: f64) -> f32 {
    ((distance_sq * GAP_SLACK) as f32).next_up()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gap_between_boxes_is_never_beyond_reach_of_what_is_in_them() {
        let one = Bounds { min: [0.0; 3], max: [1.0; 3] };
        let gap = |min, max| one.gap_sq(&Bounds { min, max });
        assert_eq!(gap([0.5; 3], [2.0; 3]), 0.0);
        assert_eq!(gap([4.0, 0.0, 5.0], [9.0; 3]), 25.0);
        assert_eq!(gap([-9.0; 3], [-4.0, 0.5, -3.0]), 25.0);
        // Out of the range of single precision on both ends.
        assert!(gap([3e38; 3], [3.1e38; 3]) <= reach_sq(3e76));
        for distance in [1e-40_f64, 1e-25, 0.1, 1.0, 1e15, 1e19] {
            let here = Bounds::around([distance, 0.3, 0.3]);
            let origin = Bounds { min: [0.0; 3], max: [0.0, 1.0, 1.0] };
            assert!(here.gap_sq(&origin) <= reach_sq(distance * distance), "{distance}");
        }
    }

    #[test]
    fn a_point_of_double_precision_is_in_the_box_around_it() {
        for point in [[0.1, -0.1, 0.5], [1e9 + 0.3, -1e-300, 0.0]] {
            let bounds = Bounds::around(point);
            for axis in 0..3 {
                let (min, max) = (f64::from(bounds.min[axis]), f64::from(bounds.max[axis]));
                assert!(min <= point[axis] && point[axis] <= max, "{point:?}");
            }
        }
    }

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
    fn a_box_around_triangles_is_the_box_around_their_corners() {
        let number = |i: u16| if i % 11 == 3 { f32::NAN } else { f32::from(i * 37 % 101) - 50.0 };
        for count in [0, 1, 2, 40] {
            let triangles =
                (0..count).map(|t| [0, 3, 6].map(|c| [0, 1, 2].map(|i| number(9 * t + c + i))));
            let (mut all, mut each) = (Bounds::default(), Bounds::default());
            all.add_triangles(triangles.clone());
            triangles.flatten().for_each(|corner| each.add(corner));
            assert_eq!(all, each);
        }
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
