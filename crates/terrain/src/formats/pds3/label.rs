//! ODL labels: statements `KEY = VALUE <UNIT>` in nested objects.

use super::refuse;
use crate::TerrainError;

/// Most statements of a label.
const STATEMENTS_MAX: usize = 20_000;

/// The statements of a label, with the object each is in.
pub(super) struct Label {
    statements: Vec<Statement>,
}

struct Statement {
    object: String,
    key: String,
    value: String,
    unit: Option<String>,
}

impl Label {
    /// Reads up to the statement END, or the end of the text.
    pub fn parse(text: &str) -> Result<Label, TerrainError> {
        let mut rest = text.trim_start_matches('\u{feff}');
        if !rest.trim_start().starts_with("PDS_VERSION_ID") && !text.contains("^IMAGE") {
            return Err(refuse("PDS_VERSION_ID", "is not at the beginning: no PDS3 label".into()));
        }
        let mut statements = Vec::new();
        let mut objects: Vec<String> = Vec::new();
        loop {
            rest = skip_blank(rest);
            let ends = |c: char| c.is_whitespace() || c.is_control() || c == '=';
            let end = rest.find(ends).unwrap_or(rest.len());
            let key = rest[..end].to_ascii_uppercase();
            rest = &rest[end..];
            if key.is_empty() || key == "END" {
                break;
            }
            let after = rest.trim_start();
            let is_closing = key == "END_OBJECT" || key == "END_GROUP";
            let Some(after) = after.strip_prefix('=') else {
                if is_closing {
                    objects.pop();
                    continue;
                }
                return Err(refuse(&key, "has no value: not a PDS3 label".into()));
            };
            let (value, unit, after) = value(after, &key)?;
            rest = after;
            match key.as_str() {
                "OBJECT" | "GROUP" => objects.push(value.to_ascii_uppercase()),
                _ if is_closing => drop(objects.pop()),
                _ => {
                    let object = objects.last().cloned().unwrap_or_default();
                    statements.push(Statement { object, key, value, unit });
                }
            }
            if statements.len() + objects.len() > STATEMENTS_MAX {
                let text = format!("is one of more than {STATEMENTS_MAX} statements");
                return Err(refuse("label", text));
            }
        }
        Ok(Label { statements })
    }

    fn find(&self, object: &str, key: &str) -> Option<&Statement> {
        self.statements.iter().find(|s| s.key == key && s.object == object)
    }

    /// A value as text.
    pub fn text(&self, object: &str, key: &str) -> Option<&str> {
        self.find(object, key).map(|s| s.value.as_str())
    }

    /// The unit of a value.
    pub fn unit(&self, object: &str, key: &str) -> Option<&str> {
        self.find(object, key).and_then(|s| s.unit.as_deref())
    }

    /// A finite number.
    pub fn number(&self, object: &str, key: &str) -> Result<Option<f64>, TerrainError> {
        let Some(text) = self.text(object, key) else { return Ok(None) };
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => Err(refuse(key, format!("is {:?}, not a finite number", short(text)))),
        }
    }

    /// A number of things.
    pub fn integer(&self, object: &str, key: &str) -> Result<Option<u64>, TerrainError> {
        let Some(text) = self.text(object, key) else { return Ok(None) };
        let parsed = text.parse().map(Some);
        parsed.map_err(|_| refuse(key, format!("is {:?}, not a whole number", short(text))))
    }

    /// The file that an object is in, if it is another one, and the byte at which it begins there.
    pub fn pointer(&self, object: &str) -> Result<(Option<String>, u64), TerrainError> {
        let key = format!("^{object}");
        let Some(found) = self.find("", &key) else {
            return Err(refuse(&key, "is missing: the label points to no image".into()));
        };
        let list = found.value.trim().trim_start_matches('(').trim_end_matches(')');
        let (mut file, mut place, mut unit) = (None, "1", found.unit.as_deref());
        if found.value.trim().starts_with('(') {
            let (name, rest) = list.split_once(',').unwrap_or((list, "1"));
            file = Some(name.trim().trim_matches('"').to_owned());
            place = rest.trim();
        } else if list.parse::<u64>().is_ok() {
            place = list;
        } else {
            file = Some(list.trim().to_owned());
        }
        if let Some((number, rest)) = place.split_once('<') {
            place = number.trim();
            unit = Some(rest.trim_end_matches('>').trim());
        }
        let bad = || refuse(&key, format!("is {:?}, no place in a file", short(&found.value)));
        let place: u64 = place.parse().map_err(|_| bad())?;
        let from_zero = place.checked_sub(1).ok_or_else(bad)?;
        if unit.is_some_and(|unit| unit.eq_ignore_ascii_case("BYTES")) {
            return Ok((file, from_zero));
        }
        if from_zero == 0 {
            return Ok((file, 0));
        }
        let Some(record) = self.integer("", "RECORD_BYTES")? else {
            return Err(refuse("RECORD_BYTES", "is missing".into()));
        };
        Ok((file, from_zero.checked_mul(record).ok_or_else(bad)?))
    }
}

/// What stands for a value in a message.
fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// Leaves white space and comments out.
fn skip_blank(mut text: &str) -> &str {
    loop {
        text = text.trim_start();
        let Some(comment) = text.strip_prefix("/*") else { return text };
        // A comment ends with its line at the latest.
        let end = comment.find("*/").map(|i| i + 2);
        let line = comment.find('\n').map(|i| i + 1);
        let end = match (end, line) {
            (Some(end), Some(line)) => end.min(line),
            (end, line) => end.or(line).unwrap_or(comment.len()),
        };
        text = &comment[end..];
    }
}

/// A value with its unit, and what follows.
fn value<'a>(text: &'a str, key: &str) -> Result<(String, Option<String>, &'a str), TerrainError> {
    let text = skip_blank(text);
    let open = || refuse(key, "is not closed: the label is truncated".into());
    let (value, rest) = match text.chars().next() {
        Some(quote @ ('"' | '\'')) => {
            let end = text[1..].find(quote).ok_or_else(open)? + 1;
            (text[1..end].to_owned(), &text[end + 1..])
        }
        Some(bracket @ ('(' | '{')) => {
            let close = if bracket == '(' { ')' } else { '}' };
            let end = text.find(close).ok_or_else(open)?;
            (text[..=end].to_owned(), &text[end + 1..])
        }
        _ => {
            let end = text.find(['\n', '\r']).unwrap_or(text.len());
            let end = text[..end].find("/*").unwrap_or(end);
            let end = text[..end].find('<').unwrap_or(end);
            (text[..end].trim().to_owned(), &text[end..])
        }
    };
    let blanks = rest.trim_start_matches([' ', '\t']);
    if let Some(unit) = blanks.strip_prefix('<') {
        let end = unit.find('>').ok_or_else(open)?;
        return Ok((value, Some(unit[..end].trim().to_owned()), &unit[end + 1..]));
    }
    Ok((value, None, rest))
}
