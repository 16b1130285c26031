//! Packs records into batches of even size, whatever pieces they come in: the batches, too, are
//! the same for any thread count.

use crate::{
    Result,
    formats::{BATCH_RECORDS, Batch, Content},
};

/// Receives the batches.
pub(super) type Sink<'a> = dyn FnMut(&Batch) -> Result<()> + 'a;

/// Records of one kind on their way to a sink.
pub(super) struct Delivery<'a, 'b> {
    batch: Batch,
    sink: &'a mut Sink<'b>,
    delivered: u64,
}

impl<'a, 'b> Delivery<'a, 'b> {
    pub(super) fn new(content: Content, sink: &'a mut Sink<'b>) -> Self {
        let batch = Batch { content, ..Batch::default() };
        Self { batch, sink, delivered: 0 }
    }

    /// Appends vertices, or triangles of a soup by three positions each.
    pub(super) fn positions(&mut self, mut positions: &[[f32; 3]]) -> Result<()> {
        let per_record = if self.batch.content == Content::Soup { 3 } else { 1 };
        while !positions.is_empty() {
            let room = BATCH_RECORDS * per_record - self.batch.positions.len();
            let (taken, rest) = positions.split_at(room.min(positions.len()));
            self.batch.positions.extend_from_slice(taken);
            positions = rest;
            self.send_if_full()?;
        }
        Ok(())
    }

    /// Appends triangles by three vertex indices each.
    pub(super) fn corners(&mut self, mut corners: &[u64]) -> Result<()> {
        while !corners.is_empty() {
            let room = BATCH_RECORDS * 3 - self.batch.faces.corners.len();
            let (taken, rest) = corners.split_at(room.min(corners.len()));
            self.batch.faces.corners.extend_from_slice(taken);
            corners = rest;
            self.send_if_full()?;
        }
        Ok(())
    }

    /// Hands over what is left; says how many records there were.
    pub(super) fn finish(mut self) -> Result<u64> {
        self.send()?;
        Ok(self.delivered)
    }

    fn send_if_full(&mut self) -> Result<()> {
        if self.batch.count() == BATCH_RECORDS { self.send() } else { Ok(()) }
    }

    fn send(&mut self) -> Result<()> {
        if self.batch.count() > 0 {
            self.delivered += self.batch.count() as u64;
            (self.sink)(&self.batch)?;
            self.batch.reset(self.batch.content);
        }
        Ok(())
    }
}
