//! Records of any layout, number by number, from either encoding.

use super::{
    super::{
        Batch,
        fault::{FormatError, Result},
        findings::DefectKind,
    },
    intake::Intake,
    layout::Step,
    scalar::Scalar,
    values::Values,
};
use crate::error::Fault;

/// Corners of a face that is carried. Chosen by hand, so that one face does not fill the memory.
const CORNERS_MAX: u64 = 1 << 20;

/// Reads the vertices `records`.
pub(super) fn vertices<V: Values>(
    values: &mut V,
    steps: &[Step],
    records: std::ops::Range<u64>,
    intake: &mut Intake,
    batch: &mut Batch,
) -> Result<()> {
    let has_colors = steps.iter().any(|step| matches!(step, Step::Channel(..)));
    for record in records {
        values.begin_record();
        let mut position = [0.0; 3];
        let mut color = [u8::MAX; 4];
        for step in steps {
            match *step {
                Step::Axis(scalar, axis) => position[axis] = values.number(scalar)?,
                Step::Channel(scalar, channel) => {
                    color[channel] = channel_from(scalar, values.number(scalar)?);
                }
                _ => skip(values, step)?,
            }
        }
        let placed = intake.place(position);
        if placed.is_none() {
            intake.bad_vertex(|| values.place().in_record(record))?;
        }
        batch.positions.push(placed.unwrap_or([f32::NAN; 3]));
        if has_colors {
            batch.colors.push(color);
        }
    }
    Ok(())
}

/// Reads one face.
pub(super) fn face<V: Values>(
    values: &mut V,
    steps: &[Step],
    record: u64,
    intake: &mut Intake,
    batch: &mut Batch,
) -> Result<()> {
    values.begin_record();
    intake.corners.clear();
    for step in steps {
        let Step::Corners { count, item } = *step else {
            skip(values, step)?;
            continue;
        };
        let count = values.list_count(count, item)?;
        if count > CORNERS_MAX {
            let fault = Fault::Unsupported("a face of more than a million corners");
            return Err(FormatError::input(values.place(), fault));
        }
        values.indices(item, count as usize, &mut intake.corners)?;
    }
    if intake.corners.len() < 3 {
        let at = || values.place().in_record(record);
        intake.findings.add_one(DefectKind::TooFewCorners, at);
        return Ok(());
    }
    if let Some(&index) = intake.corners.iter().find(|&&index| index >= intake.vertices) {
        return intake.bad_index(index, || values.place().in_record(record));
    }
    batch.faces.push(&intake.corners);
    Ok(())
}

/// Reads the rest of the strip under way or the next one, at most about `triangles_max`
/// triangles; `true` when the strip is complete.
pub(super) fn strip<V: Values>(
    values: &mut V,
    steps: &[Step],
    triangles_max: usize,
    intake: &mut Intake,
    batch: &mut Batch,
) -> Result<bool> {
    let list_at = steps.iter().position(|step| matches!(step, Step::Corners { .. }));
    let list_at = list_at.expect("the layout of strips has indices");
    let Step::Corners { count, item } = steps[list_at] else { return Ok(true) };
    if intake.strip.left == 0 {
        values.begin_record();
        for step in &steps[..list_at] {
            skip(values, step)?;
        }
        let indices = values.list_count(count, item)?;
        intake.begin_strip(indices);
    }
    let room = triangles_max.saturating_sub(batch.faces.count()).max(1);
    let here = intake.strip.left.min(room as u64);
    let mut indices = std::mem::take(&mut intake.corners);
    indices.clear();
    let read = values.indices(item, here as usize, &mut indices);
    for &index in &indices {
        intake.strip_index(index, || values.place(), batch)?;
    }
    intake.corners = indices;
    read?;
    intake.strip.left -= here;
    if intake.strip.left > 0 {
        return Ok(false);
    }
    for step in &steps[list_at + 1..] {
        skip(values, step)?;
    }
    Ok(true)
}

/// Passes over one record.
pub(super) fn skip_record<V: Values>(values: &mut V, steps: &[Step]) -> Result<()> {
    values.begin_record();
    steps.iter().try_for_each(|step| skip(values, step))
}

fn skip<V: Values>(values: &mut V, step: &Step) -> Result<()> {
    match *step {
        Step::Skip { bytes, words } => values.skip(bytes, words),
        Step::SkipList { count, item } | Step::Corners { count, item } => {
            let count = values.list_count(count, item)?;
            // A count that overflows was beyond any size as well.
            let bytes = count.saturating_mul(item.size_bytes() as u64);
            values.skip(bytes, count)
        }
        Step::Axis(scalar, _) | Step::Channel(scalar, _) => {
            values.skip(scalar.size_bytes() as u64, 1)
        }
    }
}

/// A colour of 0 to 255: floats are shares of 1, 16-bit numbers shares of 65535.
#[inline]
pub(super) fn channel_from(scalar: Scalar, value: f64) -> u8 {
    // The cast saturates, and makes 0 of NaN.
    match scalar {
        Scalar::F32 | Scalar::F64 => (value * 255.0).round() as u8,
        Scalar::U16 => (value / 257.0).round() as u8,
        _ => value as u8,
    }
}
