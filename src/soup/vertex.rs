//! What travels with a vertex. Records are generic over it: a further payload is one new type.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::storage::Record;

/// A vertex as stored: a position and perhaps more.
pub trait Vertex: Record + PartialEq + std::fmt::Debug {
    /// Record kind of a triangle of such vertices.
    const TRIANGLE_KIND: [u8; 4];
    /// Whether [`Self::color`] means anything.
    const COLORED: bool;

    /// Puts a vertex together; the colour is ignored by payloads without one.
    fn new(position: [f32; 3], color: [u8; 4]) -> Self;

    /// Position relative to the mesh's origin, in model units.
    fn position(&self) -> [f32; 3];

    /// RGBA; opaque white for payloads without colour.
    fn color(&self) -> [u8; 4];

    /// Sums of the attributes that are averaged where vertices are merged, one number each.
    type Sums: AsRef<[i32]>
        + AsMut<[i32]>
        + Copy
        + Default
        + Send
        + Sync
        + FromBytes
        + IntoBytes
        + Immutable
        + KnownLayout;

    /// The attributes, each as a share (0 to 1) of `weight`.
    fn weigh(&self, weight: i32) -> Self::Sums;

    /// A vertex at `position` with the mean attributes of `sums` over the summed `weight`.
    fn mean(position: [f32; 3], sums: [i64; ATTRIBUTES_MAX], weight: i64) -> Self;
}

/// Most attributes a payload can average.
pub const ATTRIBUTES_MAX: usize = 4;

/// A position, 12 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(transparent)]
pub struct Point(pub [f32; 3]);

/// A position with a colour, 16 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub struct ColoredPoint {
    /// Position, as [`Vertex::position`].
    pub position: [f32; 3],
    /// RGBA.
    pub color: [u8; 4],
}

/// One soup triangle: three corners, counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(transparent)]
pub struct Triangle<V>(pub [V; 3]);

impl Record for Point {
    const KIND: [u8; 4] = *b"PNT ";
}

impl Record for ColoredPoint {
    const KIND: [u8; 4] = *b"PNTC";
}

impl<V: Vertex> Record for Triangle<V> {
    const KIND: [u8; 4] = V::TRIANGLE_KIND;
}

impl Vertex for Point {
    const TRIANGLE_KIND: [u8; 4] = *b"TRI ";
    const COLORED: bool = false;

    fn new(position: [f32; 3], _: [u8; 4]) -> Self {
        Self(position)
    }

    fn position(&self) -> [f32; 3] {
        self.0
    }

    fn color(&self) -> [u8; 4] {
        [255; 4]
    }

    type Sums = [i32; 0];

    fn weigh(&self, _: i32) -> Self::Sums {
        []
    }

    fn mean(position: [f32; 3], _: [i64; ATTRIBUTES_MAX], _: i64) -> Self {
        Self(position)
    }
}

impl Vertex for ColoredPoint {
    const TRIANGLE_KIND: [u8; 4] = *b"TRIC";
    const COLORED: bool = true;

    fn new(position: [f32; 3], color: [u8; 4]) -> Self {
        Self { position, color }
    }

    fn position(&self) -> [f32; 3] {
        self.position
    }

    fn color(&self) -> [u8; 4] {
        self.color
    }

    type Sums = [i32; 4];

    fn weigh(&self, weight: i32) -> Self::Sums {
        let weight = i64::from(weight);
        self.color.map(|channel| ((weight * i64::from(channel) + 127) / 255) as i32)
    }

    fn mean(position: [f32; 3], sums: [i64; ATTRIBUTES_MAX], weight: i64) -> Self {
        let weight = weight.max(1) as f64;
        let color = sums.map(|sum| (sum as f64 / weight * 255.0).round().clamp(0.0, 255.0) as u8);
        Self { position, color }
    }
}
