//! Writes glTF 2.0 in its binary container (GLB): one mesh with positions, smooth normals and, if
//! there are any, colours.
//!
//! Bounds and normals stand before what they follow from, so that all of the mesh is kept until the
//! end: for meshes that fit in memory. Positions are single precision relative to the mesh's origin,
//! which is the translation of the node.

use std::io::Write;

use glam::Vec3;
use serde_json::json;
use zerocopy::IntoBytes as _;

use super::{
    Batch, Content, Counts, MeshWriter, WriteOptions,
    fault::{FormatError, Result},
};

/// First bytes of the container, and its version.
const MAGIC: &[u8; 4] = b"glTF";
const VERSION: u32 = 2;
/// Types of its two chunks.
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";
/// glTF's numbers for types of components, and for what a buffer view is of.
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Bytes of the binary chunk at most: all of the file is counted by 32 bits, of which some are for
/// the JSON.
const BINARY_BYTES_MAX: u64 = (1 << 32) - (1 << 16);

/// A GLB file being written.
pub struct Writer<W> {
    out: W,
    options: WriteOptions,
    positions: Vec<[f32; 3]>,
    colors: Vec<[u8; 4]>,
    faces: Vec<[u32; 3]>,
}

impl<W: Write + Send> Writer<W> {
    /// A writer of so many vertices and triangles, about.
    ///
    /// # Errors
    /// [`FormatError::Limit`] when there are more than the format can count.
    pub fn new(out: W, counts: Counts, options: &WriteOptions) -> Result<Self> {
        check_limit(counts)?;
        let (positions, colors, faces) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { out, options: *options, positions, colors, faces })
    }

    /// Sums of the normals of the faces around each vertex, weighted by area, made as long as 1; of a
    /// vertex without any, up.
    fn normals(&self) -> Vec<[f32; 3]> {
        let at = |vertex: u32| Vec3::from_array(self.positions[vertex as usize]).as_dvec3();
        let mut sums = vec![glam::DVec3::ZERO; self.positions.len()];
        for face in &self.faces {
            let [a, b, c] = face.map(at);
            let normal = (b - a).cross(c - a);
            for vertex in face {
                sums[*vertex as usize] += normal;
            }
        }
        let unit = |sum: glam::DVec3| sum.normalize_or(glam::DVec3::Z).as_vec3().to_array();
        sums.into_iter().map(unit).collect()
    }

    /// What the file says of itself; views and accessors are in the order of the binary chunk.
    fn json(&self) -> serde_json::Value {
        let (vertices, faces) = (self.positions.len(), self.faces.len());
        let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for position in &self.positions {
            for axis in 0..3 {
                min[axis] = min[axis].min(position[axis]);
                max[axis] = max[axis].max(position[axis]);
            }
        }
        let mut views = Vec::new();
        let mut start = 0;
        let mut view = |bytes: usize, target: u32| {
            views.push(json!({
                "buffer": 0, "byteOffset": start, "byteLength": bytes, "target": target,
            }));
            start += bytes;
        };
        view(12 * vertices, ARRAY_BUFFER);
        view(12 * vertices, ARRAY_BUFFER);
        let mut accessors = vec![
            json!({
                "bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3",
                "min": min, "max": max,
            }),
            json!({"bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3"}),
        ];
        let mut attributes = json!({"POSITION": 0, "NORMAL": 1});
        if self.options.colors {
            view(4 * vertices, ARRAY_BUFFER);
            attributes["COLOR_0"] = json!(2);
            accessors.push(json!({
                "bufferView": 2, "componentType": UNSIGNED_BYTE, "normalized": true,
                "count": vertices, "type": "VEC4",
            }));
        }
        view(12 * faces, ELEMENT_ARRAY_BUFFER);
        let indices = accessors.len();
        accessors.push(json!({
            "bufferView": indices, "componentType": UNSIGNED_INT, "count": 3 * faces,
            "type": "SCALAR",
        }));
        let mut node = json!({"mesh": 0});
        if self.options.origin != [0.0; 3] {
            node["translation"] = json!(self.options.origin);
        }
        json!({
            "asset": {"version": "2.0", "generator": "meshmill"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [node],
            "meshes": [{"primitives": [{
                "attributes": attributes, "indices": indices, "material": 0,
            }]}],
            "materials": [{
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.8},
                "doubleSided": true,
            }],
            "buffers": [{"byteLength": start}],
            "bufferViews": views,
            "accessors": accessors,
        })
    }
}

impl<W: Write + Send> MeshWriter for Writer<W> {
    fn write_batch(&mut self, batch: &Batch) -> Result<()> {
        match batch.content {
            Content::Vertices => {
                self.positions.extend_from_slice(&batch.positions);
                if self.options.colors {
                    self.colors.extend_from_slice(&batch.colors);
                    // Where only some inputs have colours, the rest is white.
                    self.colors.resize(self.positions.len(), [u8::MAX; 4]);
                }
            }
            Content::Faces => {
                let (triangles, _) = batch.faces.corners.as_chunks::<3>();
                self.faces.extend(triangles.iter().map(|corners| corners.map(|v| v as u32)));
            }
            Content::Soup => panic!("GLB is an indexed format"),
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Vec<u8>>> {
        let (vertices, triangles) = (self.positions.len() as u64, self.faces.len() as u64);
        check_limit(Counts { vertices, triangles })?;
        let mut json = self.json().to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let normals = self.normals();
        let parts = [
            self.positions.as_bytes(),
            normals.as_bytes(),
            self.colors.as_bytes(),
            self.faces.as_bytes(),
        ];
        let binary_bytes: usize = parts.iter().map(|part| part.len()).sum();
        let length = 12 + 8 + json.len() + 8 + binary_bytes;
        let mut head = Vec::new();
        head.extend_from_slice(MAGIC);
        head.extend_from_slice(&VERSION.to_le_bytes());
        head.extend_from_slice(&(length as u32).to_le_bytes());
        head.extend_from_slice(&(json.len() as u32).to_le_bytes());
        head.extend_from_slice(JSON_CHUNK);
        head.extend_from_slice(&json);
        head.extend_from_slice(&(binary_bytes as u32).to_le_bytes());
        head.extend_from_slice(BINARY_CHUNK);
        for part in [head.as_slice()].into_iter().chain(parts) {
            self.out.write_all(part).map_err(FormatError::write)?;
        }
        self.out.flush().map_err(FormatError::write)?;
        Ok(None)
    }
}

fn check_limit(counts: Counts) -> Result<()> {
    let limit = BINARY_BYTES_MAX / 28;
    let (format, count) = ("glb", counts.vertices.max(counts.triangles));
    if counts.vertices.saturating_mul(28).saturating_add(counts.triangles.saturating_mul(12))
        <= BINARY_BYTES_MAX
    {
        return Ok(());
    }
    Err(FormatError::Limit { format, what: "vertices or triangles", limit, count })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::{Faces, Precision};

    /// What a file says of itself, and its binary chunk.
    fn taken_apart(bytes: &[u8]) -> (serde_json::Value, Vec<u8>) {
        let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], number(4), number(8)), (&MAGIC[..], 2, bytes.len()));
        let json_bytes = number(12);
        assert!(json_bytes.is_multiple_of(4) && &bytes[16..20] == JSON_CHUNK);
        let binary = 20 + json_bytes;
        assert!(&bytes[binary + 4..binary + 8] == BINARY_CHUNK);
        assert_eq!(number(binary), bytes.len() - binary - 8);
        let json = serde_json::from_slice(&bytes[20..binary]).unwrap();
        (json, bytes[binary + 8..].to_vec())
    }

    /// 2---3   in the plane z = 1
    /// | \ |
    /// 0---1
    fn square(colors: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options =
            WriteOptions { precision: Precision::Single, origin: [1e6, 0.0, -2.5], colors };
        let counts = Counts { vertices: 4, triangles: 2 };
        let mut writer = Writer::new(&mut bytes, counts, &options).unwrap();
        let vertices = Batch {
            positions: vec![[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 3.0, 1.0], [2.0, 3.0, 1.0]],
            colors: vec![[1, 2, 3, 4]; 4],
            ..Batch::default()
        };
        let corners = vec![0, 1, 2, 1, 3, 2];
        let faces = Faces { corners, ends: Vec::new() };
        writer.write_batch(&vertices).unwrap();
        writer.write_batch(&Batch { content: Content::Faces, faces, ..Batch::default() }).unwrap();
        assert_eq!(writer.finish().unwrap(), None);
        bytes
    }

    #[test]
    fn the_container_says_where_everything_lies() {
        for colors in [false, true] {
            let (json, binary) = taken_apart(&square(colors));
            assert_eq!(json["nodes"][0]["translation"], json!([1e6, 0.0, -2.5]));
            let positions = &json["accessors"][0];
            assert_eq!(
                (&positions["min"], &positions["max"]),
                (&json!([0.0, 0.0, 1.0]), &json!([2.0, 3.0, 1.0]))
            );
            assert_eq!(json["buffers"][0]["byteLength"], binary.len());
            let mut end = 0;
            for (accessor, view) in json["accessors"]
                .as_array()
                .unwrap()
                .iter()
                .zip(json["bufferViews"].as_array().unwrap())
            {
                assert_eq!(view["byteOffset"], end);
                let components = match accessor["type"].as_str().unwrap() {
                    "VEC3" => 3,
                    "VEC4" => 4,
                    _ => 1,
                };
                let size = if accessor["componentType"] == UNSIGNED_BYTE { 1 } else { 4 };
                let bytes = accessor["count"].as_u64().unwrap() * components * size;
                assert_eq!(view["byteLength"], bytes);
                end += bytes;
            }
            assert_eq!(end, binary.len() as u64);
            let has_colors = !json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].is_null();
            assert_eq!(has_colors, colors);
            // Normals look up.
            let up: Vec<u8> = [0.0_f32, 0.0, 1.0].iter().flat_map(|c| c.to_le_bytes()).collect();
            assert!(binary[48..96].chunks(12).all(|normal| normal == up));
            let last: Vec<u8> = [1_u32, 3, 2].iter().flat_map(|c| c.to_le_bytes()).collect();
            assert!(binary.ends_with(&last));
        }
    }

    #[test]
    fn more_than_32_bits_can_count_is_refused_before_anything_is_written() {
        let options =
            WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
        let counts = Counts { vertices: 1 << 27, triangles: 1 << 28 };
        let refused = Writer::new(Vec::new(), counts, &options).err();
        assert!(matches!(refused, Some(FormatError::Limit { format: "glb", .. })));
    }
}
