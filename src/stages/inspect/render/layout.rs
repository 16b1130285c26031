//! Where the panels of a picture lie.

use super::camera::Area;

/// Divides a picture into `count` panels side by side, in rows, as large as they can be.
pub(super) fn panels(count: usize, width: usize, height: usize) -> Vec<Area> {
    let rows_of = |columns: usize| count.div_ceil(columns);
    let side = |columns: usize| (width / columns).min(height / rows_of(columns));
    let empty = |columns: usize| columns * rows_of(columns) - count;
    let columns = (1..=count).max_by_key(|&columns| (side(columns), usize::MAX - empty(columns)));
    let columns = columns.unwrap_or(1);
    let rows = rows_of(columns);
    let panel = |index: usize| {
        let (column, row) = (index % columns, index / columns);
        let (left, right) = (column * width / columns, (column + 1) * width / columns);
        let (top, bottom) = (row * height / rows, (row + 1) * height / rows);
        Area { left, top, width: right - left, height: bottom - top }
    };
    (0..count).map(panel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_are_as_large_as_can_be_and_none_is_left_empty() {
        let area = |left, top, width, height| Area { left, top, width, height };
        assert_eq!(panels(1, 1600, 1200), [area(0, 0, 1600, 1200)]);
        assert_eq!(panels(2, 100, 300), [area(0, 0, 100, 150), area(0, 150, 100, 150)]);
        let eight = panels(8, 1600, 1200);
        assert_eq!((eight[0], eight[7]), (area(0, 0, 400, 600), area(1200, 600, 400, 600)));
        assert_eq!(panels(3, 900, 300)[2], area(600, 0, 300, 300));
    }
}
