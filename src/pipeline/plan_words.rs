//! A plan in words: in a line, and all of it.

use std::fmt;

use super::Plan;

impl Plan {
    /// All that is needed, in a line.
    #[must_use]
    pub fn summary(&self) -> String {
        let memory = size(self.memory_expected_bytes);
        let time = self.time().map(|time| format!("{time}, ")).unwrap_or_default();
        format!("{time}{memory} of memory, temporary files {}", self.temporary())
    }

    /// Temporary files, in words.
    fn temporary(&self) -> String {
        let free = self.temp_dir_available_bytes;
        let free = free.map(|bytes| format!(", {} free", size(bytes))).unwrap_or_default();
        let place = format!("in {}{free}", self.temp_dir.display());
        match self.temporary_bytes {
            Some(0) => "0 B".to_owned(),
            Some(bytes) if self.unsorted_bytes > 0 => {
                let least = size(bytes.saturating_sub(self.unsorted_bytes));
                format!("{least} if in order, else {} {place}", size(bytes))
            }
            bytes => format!("{} {place}", known(bytes)),
        }
    }

    /// Time from beginning to end, in words, if that can be told.
    fn time(&self) -> Option<String> {
        let seconds = self.seconds()?;
        let about = format!("about {}", span(seconds));
        if self.unsorted_bytes == 0 || self.unsorted_seconds == 0.0 {
            return Some(about);
        }
        Some(format!("{about} if in order, else {}", span(seconds + self.unsorted_seconds)))
    }
}

/// A size in words.
fn size(bytes: u64) -> String {
    bytesize::ByteSize(bytes).to_string()
}

/// A size in words, if it is known.
fn known(bytes: Option<u64>) -> String {
    bytes.map_or("known only at the end".to_owned(), size)
}

/// A span of time in plain words.
fn span(seconds: f64) -> String {
    match seconds {
        ..90.0 => format!("{seconds:.1} s"),
        ..5400.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, planned) in self.stages.iter().enumerate() {
            writeln!(f, "{:2}. {:11} {}", index + 1, planned.stage.name(), planned.what)?;
        }
        if let Some(choice) = &self.method {
            writeln!(f, "method     {choice}")?;
        }
        let [expected, most] = [self.memory_expected_bytes, self.memory_bytes].map(size);
        writeln!(f, "memory     about {expected}, at most {most}")?;
        writeln!(f, "temporary  {}", self.temporary())?;
        writeln!(f, "output     {}", known(self.output_bytes))?;
        if let Some(time) = self.time() {
            writeln!(f, "time       {time}")?;
        }
        for note in &self.notes {
            writeln!(f, "note       {note}")?;
        }
        Ok(())
    }
}
