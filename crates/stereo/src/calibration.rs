//! Calibrations as other programs write them, read from their text.
//!
//! | function | what |
//! |---|---|
//! | [`read_tsai`] | pinhole models of the Ames Stereo Pipeline, `.tsai`, old and `VERSION_3`/`4` |
//! | [`read_cahvor`] | CAHV and CAHVOR models of planetary cameras, `.cahv`, `.cahvor` |
//! | [`read_opencv`], [`read_opencv_pair`] | YAML of OpenCV and of ROS `camera_info`, one camera or a pair |
//! | [`read_middlebury`] | `calib.txt` of the Middlebury 2014 pairs |
//!
//! Lengths are meters but for the baseline of Middlebury (mm) and for an OpenCV translation, whose unit
//! is that of the calibration board and has to be given. What does not fit is named, never guessed.

mod cahvor;
mod middlebury;
mod opencv;
mod tsai;

pub use cahvor::read_cahvor;
pub use middlebury::read_middlebury;
pub use opencv::{read_opencv, read_opencv_pair};
pub use tsai::read_tsai;

use nalgebra::{Matrix3, Vector3};

use crate::StereoError;

/// Largest calibration text that is read.
const TEXT_MAX: usize = 1 << 20;

/// One `name = value` of a text, with its line for messages.
struct Entry<'a> {
    line: usize,
    name: &'a str,
    value: &'a str,
}

/// The `name = value` lines of a text; lines without `=` come with an empty value.
struct Entries<'a> {
    format: &'static str,
    entries: Vec<Entry<'a>>,
}

fn check_size(text: &str) -> Result<(), StereoError> {
    if text.len() <= TEXT_MAX {
        Ok(())
    } else {
        Err(StereoError::TextTooLarge { n_bytes: text.len() })
    }
}

impl<'a> Entries<'a> {
    fn parse(format: &'static str, text: &'a str) -> Result<Entries<'a>, StereoError> {
        check_size(text)?;
        let entry = |(i, line): (usize, &'a str)| {
            let line = line.split('#').next().unwrap_or_default().trim();
            let (name, value) = line.split_once('=').unwrap_or((line, ""));
            Entry { line: i + 1, name: name.trim(), value: value.trim() }
        };
        let entries = text.lines().enumerate().map(entry).filter(|e| !e.name.is_empty()).collect();
        Ok(Entries { format, entries })
    }

    fn find(&self, name: &str) -> Option<&Entry<'a>> {
        self.entries.iter().find(|e| e.name.eq_ignore_ascii_case(name))
    }

    fn get(&self, name: &str, hint: &'static str) -> Result<&Entry<'a>, StereoError> {
        let missing = || StereoError::Missing { format: self.format, field: name.into(), hint };
        self.find(name).ok_or_else(missing)
    }

    fn numbers<const N: usize>(
        &self,
        name: &str,
        hint: &'static str,
        expected: &'static str,
    ) -> Result<[f64; N], StereoError> {
        let entry = self.get(name, hint)?;
        numbers(entry.value).ok_or_else(|| self.unreadable(entry, expected))
    }

    fn number(&self, name: &str, hint: &'static str) -> Result<f64, StereoError> {
        self.numbers(name, hint, "a number").map(|[value]| value)
    }

    fn vector(&self, name: &str, hint: &'static str) -> Result<Vector3<f64>, StereoError> {
        self.numbers(name, hint, "three numbers").map(Vector3::from)
    }

    fn unreadable(&self, entry: &Entry<'_>, expected: &'static str) -> StereoError {
        unreadable(self.format, entry.line, entry.name, entry.value, expected)
    }
}

fn unreadable(
    format: &'static str,
    line: usize,
    field: &str,
    value: &str,
    expected: &'static str,
) -> StereoError {
    let (field, value) = (shortened(field), shortened(value));
    StereoError::Unreadable { format, line, field, value, expected }
}

/// At most 60 characters of a text, for messages.
fn shortened(text: &str) -> String {
    text.chars().take(60).collect()
}

/// Finite numbers apart by space, commas, semicolons or brackets: exactly `N`.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let parts = text.split(|c: char| c.is_whitespace() || ",;[]()".contains(c));
    let mut values = [0.0; N];
    let mut n = 0;
    for part in parts.filter(|part| !part.is_empty()) {
        *values.get_mut(n)? = part.parse().ok().filter(|v: &f64| v.is_finite())?;
        n += 1;
    }
    (n == N).then_some(values)
}

fn matrix(rows: [f64; 9]) -> Matrix3<f64> {
    Matrix3::from_row_slice(&rows)
}
