//! Reduces many samples to a chart: all of them if there are only a few, otherwise minimum, maximum
//! and mean of a number of buckets.

use super::{Sample, SampleQuality};

/// Maximum number of buckets of a chart.
pub const BUCKETS_MAX: usize = 4_000;

/// The chart of a point.
#[derive(Clone, Debug, PartialEq)]
pub enum Chart {
    /// All samples, preceded by the one valid at the beginning.
    Samples(Vec<Sample>),
    /// Buckets of the same length.
    Buckets(Vec<Bucket>),
}

/// A bucket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bucket {
    /// When it begins, in milliseconds since 1970.
    pub t: i64,
    /// Minimum and maximum of the values in it, and the mean over the time for which one is known;
    /// `None` if there is none.
    pub values: Option<Spread>,
    /// Number of samples in it.
    pub n: u32,
    /// The worst quality in it.
    pub grade: SampleQuality,
}

/// The distribution of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The least.
    pub min: f64,
    /// The greatest.
    pub max: f64,
    /// The mean over time.
    pub mean: f64,
}

/// Builds a chart from consecutive samples.
pub(super) struct Plotter {
    from: i64,
    to: i64,
    width: i64,
    raw_max: usize,
    /// All samples, as long as there are only a few.
    raw: Option<Vec<Sample>>,
    cells: Vec<Cell>,
    /// The current sample.
    now: Option<Sample>,
}

#[derive(Clone, Copy, Default)]
struct Cell {
    min_max: Option<(f64, f64)>,
    /// Values times milliseconds, and milliseconds.
    weighed: f64,
    weight: f64,
    n: u32,
    grade: Option<SampleQuality>,
}

impl Plotter {
    /// For samples in a half-open interval.
    pub(super) fn new(from: i64, to: i64, buckets: usize) -> Plotter {
        let buckets = buckets.clamp(1, BUCKETS_MAX);
        let span = to.saturating_sub(from).max(1);
        let width = span.div_euclid(buckets as i64) + i64::from(span % buckets as i64 != 0);
        let (raw, raw_max) = (Some(Vec::new()), buckets * 2);
        Plotter {
            raw,
            raw_max,
            ..Plotter::of_width(from, to, width)
        }
    }

    /// The same with buckets of this many milliseconds, however few samples there are; `None` if
    /// that would be more than [`BUCKETS_MAX`].
    pub(super) fn steps(from: i64, to: i64, width: i64) -> Option<Plotter> {
        let span = to.saturating_sub(from).max(1);
        let fits = width > 0 && span.saturating_sub(1) / width < BUCKETS_MAX as i64;
        fits.then(|| Plotter::of_width(from, to, width))
    }

    fn of_width(from: i64, to: i64, width: i64) -> Plotter {
        let span = to.saturating_sub(from).max(1);
        let count = span.saturating_sub(1) / width + 1;
        Plotter {
            from,
            to,
            width,
            raw_max: 0,
            raw: None,
            cells: vec![Cell::default(); usize::try_from(count).unwrap_or(1)],
            now: None,
        }
    }

    /// The next sample. The first may be older than the chart.
    pub(super) fn take(&mut self, sample: Sample) {
        self.hold_until(sample.t);
        if sample.t >= self.from
            && let Some(cell) = self.cell(sample.t)
        {
            cell.n += 1;
        }
        self.now = Some(sample);
        if let Some(raw) = &mut self.raw {
            raw.push(sample);
            if raw.len() > self.raw_max {
                self.raw = None;
            }
        }
    }

    /// The chart; nothing is known about the time after `known_to`.
    pub(super) fn end(mut self, known_to: i64) -> Chart {
        self.hold_until(known_to.min(self.to));
        if let Some(raw) = self.raw {
            return Chart::Samples(raw);
        }
        let cells = self.cells.iter().enumerate();
        let told = cells.filter_map(|(index, cell)| {
            let t = self.from + self.width * index as i64;
            cell.told(t)
        });
        Chart::Buckets(told.collect())
    }

    fn cell(&mut self, t: i64) -> Option<&mut Cell> {
        let index = usize::try_from((t - self.from) / self.width).ok()?;
        self.cells.get_mut(index)
    }

    /// The current sample remains valid until then.
    fn hold_until(&mut self, until: i64) {
        let Some(sample) = self.now else {
            return;
        };
        let mut at = sample.t.max(self.from);
        while at < until {
            let end = self.from + ((at - self.from) / self.width + 1) * self.width;
            let end = end.min(until);
            let Some(cell) = self.cell(at) else {
                return;
            };
            cell.hold(sample, (end - at) as f64);
            at = end;
        }
    }
}

impl Cell {
    fn hold(&mut self, sample: Sample, millis: f64) {
        self.grade = self.grade.max(Some(sample.grade));
        let Some(value) = sample.value else {
            return;
        };
        let (min, max) = self.min_max.unwrap_or((value, value));
        self.min_max = Some((min.min(value), max.max(value)));
        self.weighed += value * millis;
        self.weight += millis;
    }

    fn told(&self, t: i64) -> Option<Bucket> {
        let values = self.min_max.map(|(min, max)| Spread {
            min,
            max,
            // The current value was valid for some time.
            mean: (self.weighed / self.weight).clamp(min, max),
        });
        Some(Bucket {
            t,
            values,
            n: self.n,
            grade: self.grade?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(t: i64, value: f64) -> Sample {
        Sample {
            t,
            value: Some(value),
            grade: SampleQuality::Good,
        }
    }

    fn gap(t: i64) -> Sample {
        Sample {
            t,
            value: None,
            grade: SampleQuality::Bad,
        }
    }

    #[test]
    fn few_samples_are_told_as_they_are() {
        let mut plotter = Plotter::new(0, 100, 10);
        plotter.take(sample(-5, 1.0));
        plotter.take(gap(50));
        let Chart::Samples(samples) = plotter.end(100) else {
            panic!("they are few");
        };
        assert_eq!(samples, [sample(-5, 1.0), gap(50)]);
    }

    #[test]
    fn many_are_weighed_by_how_long_they_were_in_force() {
        let mut plotter = Plotter::new(0, 100, 2);
        // 1 for 10 ms, 3 for 40 ms; then nothing for 25 ms, then 5.
        for sample in [
            sample(-5, 1.0),
            sample(10, 3.0),
            gap(50),
            sample(75, 5.0),
            sample(80, 5.0),
        ] {
            plotter.take(sample);
        }
        let Chart::Buckets(buckets) = plotter.end(100) else {
            panic!("they are many");
        };
        let spread = |min, max, mean| Some(Spread { min, max, mean });
        assert_eq!(buckets.len(), 2);
        assert_eq!(buckets[0].values, spread(1.0, 3.0, 2.6));
        assert_eq!((buckets[0].n, buckets[0].grade), (1, SampleQuality::Good));
        assert_eq!(buckets[1].values, spread(5.0, 5.0, 5.0));
        assert_eq!((buckets[1].n, buckets[1].grade), (3, SampleQuality::Bad));
    }

    #[test]
    fn what_is_to_come_is_not_drawn() {
        let mut plotter = Plotter::new(0, 1_000, 10);
        for t in 0..30 {
            plotter.take(sample(t, 1.0));
        }
        let Chart::Buckets(buckets) = plotter.end(350) else {
            panic!("they are many");
        };
        assert_eq!(buckets.len(), 4);
        assert_eq!(buckets[3].t, 300);
    }
}
