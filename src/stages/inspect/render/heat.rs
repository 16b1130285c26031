//! Distances as colours: a map from pale to dark that reads the same in grey, and its scale.

use super::{
    camera::Area,
    picture::{Color, Picture, Text},
};

/// Colours of the map at equal steps, from none to all. Each is darker than the one before.
const MAP: [Color; 6] =
    [[236, 236, 230], [250, 219, 130], [246, 157, 66], [217, 83, 48], [145, 24, 64], [58, 10, 66]];

/// Colours for distances from 0 to a round number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatMap {
    /// The distance of the darkest colour; above it there is no darker one.
    top: f64,
}

/// Share of the distances that are told apart. The few beyond it would make all others pale.
const SHARE: f64 = 0.995;

impl HeatMap {
    /// A map for these distances. Those that are not finite do not count.
    #[must_use]
    pub fn new(distances: &[f64]) -> Self {
        let mut finite: Vec<f64> = distances.iter().copied().filter(|d| d.is_finite()).collect();
        if finite.is_empty() {
            return Self { top: 1.0 };
        }
        let last = ((finite.len() - 1) as f64 * SHARE) as usize;
        let (_, most, _) = finite.select_nth_unstable_by(last, f64::total_cmp);
        Self { top: round_up(*most) }
    }

    /// The colour of a distance.
    #[must_use]
    pub fn color(self, distance: f64) -> Color {
        let share = distance / self.top;
        let share = if share > 0.0 { share.min(1.0) } else { 0.0 };
        let place = share * (MAP.len() - 1) as f64;
        let index = (place as usize).min(MAP.len() - 2);
        let share = place - index as f64;
        std::array::from_fn(|channel| {
            let [from, to] = [MAP[index], MAP[index + 1]].map(|color| f64::from(color[channel]));
            (from + (to - from) * share).round() as u8
        })
    }

    /// Draws the scale into the upper half of `area`, and its numbers below.
    pub(super) fn draw(self, picture: &mut Picture, area: Area, (color, dot): (Color, usize)) {
        let height = area.height / 2;
        for column in 0..area.width {
            let share = column as f64 / (area.width - 1).max(1) as f64;
            let (left, top) = (area.left + column, area.top);
            let bar = Area { left, top, width: 1, height };
            picture.fill(bar, self.color(share * self.top));
        }
        for part in 0..=TICKS {
            let number = number(self.top * f64::from(part) / f64::from(TICKS));
            let more = if part == TICKS { "+" } else { "" };
            let text = format!("{number}{more}");
            let text = Text { text: &text, color, dot };
            let middle = area.left + area.width * part as usize / TICKS as usize;
            let least = area.left;
            let most = (area.left + area.width).saturating_sub(text.width());
            let left = middle.saturating_sub(text.width() / 2).min(most).max(least);
            picture.write(left, area.top + height + 2 * dot, text);
        }
    }
}

/// Parts of the scale that have a number at either end.
const TICKS: u32 = 4;

/// The least of 1, 2, 4 and 8 times a power of ten that is not below: their quarters are short.
fn round_up(value: f64) -> f64 {
    if !(value > 0.0 && value < 1e300) {
        return 1.0;
    }
    let power = 10_f64.powi(value.log10().floor() as i32);
    let rounded = [1.0, 2.0, 4.0, 8.0, 10.0].map(|digit| digit * power);
    // Of the least numbers the power is zero.
    rounded.into_iter().find(|rounded| *rounded >= value).unwrap_or(value)
}

/// A number in few letters: `0`, `0.025`, `1.5e-6`.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !(1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.2e}");
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{exponent}", mantissa.trim_end_matches('0').trim_end_matches('.'));
    }
    let decimals = (2 - value.abs().log10().floor() as i32).max(0) as usize;
    let text = format!("{value:.decimals$}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if text.contains('.') { short.to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_ends_at_a_round_number_that_most_distances_are_below() {
        let mut distances: Vec<f64> = (0..1000).map(|i| f64::from(i) * 3e-6).collect();
        assert_eq!(HeatMap::new(&distances), HeatMap { top: 4e-3 });
        distances[500] = f64::INFINITY;
        distances[501] = 1e9;
        assert_eq!(HeatMap::new(&distances), HeatMap { top: 4e-3 });
        assert_eq!(HeatMap::new(&[]), HeatMap { top: 1.0 });
        assert_eq!(HeatMap::new(&[0.0; 5]), HeatMap { top: 1.0 });
        assert!(HeatMap::new(&[1e-310]).top > 0.0);
    }

    #[test]
    fn more_is_darker() {
        let map = HeatMap { top: 2.0 };
        let grey = |distance: f64| {
            let [red, green, blue] = map.color(distance).map(f64::from);
            0.3 * red + 0.59 * green + 0.11 * blue
        };
        let greys: Vec<f64> = (0..=40).map(|step| grey(f64::from(step) * 0.05)).collect();
        assert!(greys.windows(2).all(|pair| pair[1] < pair[0]), "{greys:?}");
        assert_eq!(map.color(7.0), map.color(2.0));
        assert_eq!(map.color(f64::NAN), map.color(0.0));
    }

    #[test]
    fn numbers_are_short() {
        let values = [0.0, 0.025, 1.5e-6, 1.0, 12.26, 99_999.0, 1e6, 0.001, 250.0];
        let texts = ["0", "0.025", "1.5e-6", "1", "12.3", "99999", "1e6", "0.001", "250"];
        assert_eq!(values.map(number), texts);
    }
}
