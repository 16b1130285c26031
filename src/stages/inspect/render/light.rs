//! How much light a surface sends to the viewer: what makes a scan look like a thing.
//!
//! Light is linear, 0 to 1; it becomes the numbers of a picture at the very end.

use std::sync::LazyLock;

use glam::Vec3;

/// Light from all around, and more of it from above.
const AMBIENT: f32 = 0.05;
const SKY: f32 = 0.12;
/// Light from the viewer: whatever is seen is lit.
const HEAD: f32 = 0.18;
/// Light from the upper left, which shows forms.
const KEY: f32 = 0.65;
const KEY_FROM: Vec3 = Vec3::new(-0.551, -0.651, -0.522);

/// Light of a surface with a normal of length 1 in directions of the picture: to the right, down
/// and away from the viewer.
#[inline]
pub(super) fn of_normal(normal: Vec3) -> f32 {
    let sky = 0.5 - 0.5 * normal.y;
    let key = normal.dot(KEY_FROM).max(0.0);
    AMBIENT + SKY * sky - HEAD * normal.z + KEY * key
}

/// How much a smooth surface shines there, to be added.
#[inline]
pub(super) fn gloss(normal: Vec3) -> f32 {
    // Half way between the key light and the viewer; to the 32nd power.
    const HALF: Vec3 = Vec3::new(-0.316, -0.373, -0.872);
    let mut shine = normal.dot(HALF).max(0.0);
    for _ in 0..5 {
        shine *= shine;
    }
    0.05 * shine
}

/// Entries of the table from linear light to numbers: enough that dark ones lie less than one apart.
const LEVELS: usize = 4096;

/// Numbers of a picture by linear light: the curve of sRGB.
static ENCODED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let encode = |level: usize| {
        let light = level as f64 / (LEVELS - 1) as f64;
        let value = if light <= 0.003_130_8 {
            12.92 * light
        } else {
            1.055 * light.powf(1.0 / 2.4) - 0.055
        };
        (value * 255.0).round() as u8
    };
    (0..LEVELS).map(encode).collect()
});

/// Linear light of the numbers of a picture.
static DECODED: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|number| {
        let value = number as f64 / 255.0;
        let light =
            if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
        light as f32
    })
});

/// The colour of a picture for linear light.
pub(super) fn encode(light: Vec3) -> [u8; 3] {
    let top = (LEVELS - 1) as f32;
    light.to_array().map(|channel| ENCODED[(channel * top + 0.5).clamp(0.0, top) as usize])
}

/// Linear light of a colour of a picture.
pub(super) fn decode(color: [u8; 3]) -> Vec3 {
    Vec3::from_array(color.map(|number| DECODED[usize::from(number)]))
}

/// Linear light of one channel of a colour, 0 to 1.
pub(super) fn decode_share(channel: f32) -> f32 {
    DECODED[(channel * 255.0 + 0.5) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_survive_decoding_and_encoding() {
        for number in 0..=255 {
            assert_eq!(encode(decode([number, 0, 255])), [number, 0, 255]);
        }
        assert_eq!(encode(Vec3::new(-1.0, 2.0, f32::NAN)), [0, 255, 0]);
    }

    #[test]
    fn light_stays_within_its_range_and_prefers_the_upper_left() {
        let at = |x: f32, y: f32| of_normal(Vec3::new(x, y, -1.0).normalize());
        for x in -20..=20_i16 {
            for y in -20..=20_i16 {
                let normal = Vec3::new(f32::from(x), f32::from(y), -4.0).normalize();
                assert!((0.0..=1.0).contains(&of_normal(normal)) && gloss(normal) <= 0.051);
            }
        }
        assert!(at(-0.5, -0.5) > at(0.0, 0.0) && at(0.0, 0.0) > at(0.5, 0.5));
    }
}
