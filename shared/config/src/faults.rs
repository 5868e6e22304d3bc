//! What is wrong with a configuration: one line a fault, in the order of the file.

use std::fmt;

/// Where a value was written.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Origin {
    /// The file as a whole (it could not be read).
    File,
    /// A line of the file, counted from 1.
    Line(usize),
    /// An override `--set KEY`.
    Override(String),
}

/// One fault: where it is, which key it concerns, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    pub(crate) origin: Origin,
    pub(crate) file: String,
    pub(crate) message: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.origin {
            Origin::File => write!(f, "{}: {}", self.file, self.message),
            Origin::Line(line) => write!(f, "{}:{line}: {}", self.file, self.message),
            Origin::Override(key) => write!(f, "--set {key}: {}", self.message),
        }
    }
}

/// All faults of a configuration, at least one. Prints one a line, in the order of the file, those of
/// overrides last.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Faults(Vec<Fault>);

impl Faults {
    /// The faults sorted, or `Ok` when there is none.
    pub(crate) fn none_of(mut faults: Vec<Fault>) -> Result<(), Faults> {
        faults.sort_by(|a, b| a.origin.cmp(&b.origin));
        faults.dedup();
        if faults.is_empty() { Ok(()) } else { Err(Faults(faults)) }
    }

    pub(crate) fn one(file: &str, origin: Origin, message: String) -> Faults {
        Faults(vec![Fault { origin, file: file.to_owned(), message }])
    }

    /// The faults in the order in which they are printed.
    pub fn iter(&self) -> impl Iterator<Item = &Fault> {
        self.0.iter()
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.0.iter().enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write!(f, "{fault}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Faults {}
