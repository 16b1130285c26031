//! Pictures side by side, with captions above and the scale of a heat map below.

use super::{
    camera::Area,
    heat::HeatMap,
    picture::{Color, Picture, Text},
    scene::Size,
    shade::BACKGROUND,
};

/// A picture and what is said of it.
pub struct Panel<'a> {
    /// All panels of a sheet have one size.
    pub picture: &'a Picture,
    /// Its name, and more lines below.
    pub caption: &'a [String],
}

/// The name of a panel, and all other letters.
const NAME: Color = [38, 42, 50];
const LETTERS: Color = [104, 108, 118];
/// Lines of a caption at most.
const LINES: usize = 3;

/// Puts panels side by side, the scale of `heat` below the last one.
#[must_use]
pub fn side_by_side(panels: &[Panel], heat: HeatMap) -> Picture {
    let (width, height) =
        panels.first().map_or((1, 1), |p| (p.picture.width(), p.picture.height()));
    let dot = (width.min(height) / 300).max(1);
    let line = 11 * dot;
    let (above, below) = (LINES * line + line, 4 * line);
    let mut sheet = Picture::new(panels.len() * width, above + height + below, BACKGROUND);
    for (index, panel) in panels.iter().enumerate() {
        let left = index * width;
        sheet.place(left, above, panel.picture);
        for (number, text) in panel.caption.iter().take(LINES).enumerate() {
            let color = if number == 0 { NAME } else { LETTERS };
            let text = Text { text, color, dot };
            let indent = width.saturating_sub(text.width()) / 2;
            sheet.write(left + indent, line / 2 + number * line, text);
        }
    }
    let left = panels.len().saturating_sub(1) * width + width / 10;
    let scale =
        Area { left, top: above + height + line / 2, width: width * 4 / 5, height: 2 * line };
    heat.draw(&mut sheet, scale, (LETTERS, dot));
    sheet
}

/// Bytes a sheet of `count` panels takes, with the panels.
#[must_use]
pub fn sheet_bytes(panel: Size, count: usize) -> u64 {
    let pixels = (panel.width as u64).saturating_mul(panel.height as u64);
    pixels.saturating_mul(count as u64).saturating_mul(2 * size_of::<Color>() as u64)
}
