//! Units of length, and lengths as users write them.

use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Names of the common units of length, and their metres.
const UNITS: [(&[&str], f64); 5] = [
    (
        &[
            "um",
            "µm",
            "micrometre",
            "micrometer",
            "micrometres",
            "micrometers",
        ],
        1e-6,
    ),
    (
        &[
            "mm",
            "millimetre",
            "millimeter",
            "millimetres",
            "millimeters",
        ],
        1e-3,
    ),
    (
        &[
            "cm",
            "centimetre",
            "centimeter",
            "centimetres",
            "centimeters",
        ],
        1e-2,
    ),
    (&["m", "metre", "meter", "metres", "meters"], 1.0),
    (&["in", "inch", "inches"], 0.0254),
];

/// Metres of a unit; nothing for one of a scene's own.
fn metres(name: &str) -> Option<f64> {
    let name = name.trim().to_lowercase();
    let known = UNITS.iter().find(|(all, _)| all.contains(&name.as_str()));
    known.map(|(_, metres)| *metres)
}

/// Whether two names mean one unit.
pub(crate) fn is_same_unit(a: &str, b: &str) -> bool {
    match (metres(a), metres(b)) {
        (Some(a), Some(b)) => a == b,
        _ => a.trim().to_lowercase() == b.trim().to_lowercase(),
    }
}

/// A length with its unit, such as `0.05 mm`, or a bare number, which is in the unit of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Length {
    value: f64,
    unit: Option<String>,
}

/// In a file: a number, or a text.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Number(f64),
    Text(String),
}

impl Length {
    /// The length in a scene's unit.
    ///
    /// # Errors
    /// When the scene's unit has no known size; the message says the mend.
    pub fn in_unit(&self, scene_unit: &str) -> Result<f64, String> {
        let Some(unit) = &self.unit else {
            return Ok(self.value);
        };
        if is_same_unit(unit, scene_unit) {
            return Ok(self.value);
        }
        match (metres(unit), metres(scene_unit)) {
            (Some(own), Some(scene)) => Ok(self.value * own / scene),
            _ => Err(format!(
                "`{unit}` cannot be turned into the scene's unit `{scene_unit}`: give a bare number, in `{scene_unit}`"
            )),
        }
    }
}

/// No number that anybody writes is longer, in bytes.
const LONGEST_NUMBER: usize = 64;

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let wrong = || {
            format!(
                "`{text}` is no length: write a number above zero and a unit, such as \"0.05 mm\""
            )
        };
        // The longest part that is a number: an exponent begins with a letter too. Trying every length of a long text would take for ever.
        let ends = (1..=text.len().min(LONGEST_NUMBER))
            .rev()
            .filter(|&end| text.is_char_boundary(end));
        let number = |end: usize| text[..end].trim_end().parse::<f64>().ok().map(|x| (x, end));
        let (value, end) = ends.filter_map(number).next().ok_or_else(wrong)?;
        if !(value.is_finite() && value > 0.0) {
            return Err(wrong());
        }
        let unit = text[end..].trim();
        Ok(Self {
            value,
            unit: (!unit.is_empty()).then(|| unit.to_string()),
        })
    }
}

impl std::fmt::Display for Length {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match &self.unit {
            None => write!(f, "{}", self.value),
            Some(unit) => write!(f, "{} {unit}", self.value),
        }
    }
}

impl TryFrom<Written> for Length {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        match written {
            Written::Number(value) => value.to_string().parse(),
            Written::Text(text) => text.parse(),
        }
    }
}

impl From<Length> for Written {
    fn from(length: Length) -> Self {
        match length.unit {
            None => Self::Number(length.value),
            Some(_) => Self::Text(length.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_turned_into_the_unit_of_the_scene() {
        let of = |text: &str, unit: &str| text.parse::<Length>().unwrap().in_unit(unit).unwrap();
        assert!((of("0.05 mm", "cm") - 0.005).abs() < 1e-15);
        assert!((of("5e-5m", "centimetres") - 0.005).abs() < 1e-15);
        assert!((of("1in", "mm") - 25.4).abs() < 1e-12);
        assert_eq!(of("2 units", "units"), 2.0);
        assert_eq!(of("1e-3", "units"), 1e-3);
    }

    #[test]
    fn what_is_no_length_is_refused_with_the_mend() {
        for text in ["", "mm", "-1 mm", "0", "nan", "inf cm", "1e999 m"] {
            let message = text.parse::<Length>().unwrap_err();
            assert!(message.contains("0.05 mm"), "{message}");
        }
        let odd: Length = "3 furlongs".parse().unwrap();
        assert!(
            odd.in_unit("cm")
                .unwrap_err()
                .contains("bare number, in `cm`")
        );
        assert!("1 mm".parse::<Length>().unwrap().in_unit("units").is_err());
    }

    #[test]
    fn files_may_have_a_number_or_a_text() {
        for text in ["0.25", "\"0.5 mm\""] {
            let length: Length = serde_json::from_str(text).unwrap();
            assert_eq!(serde_json::to_string(&length).unwrap(), text);
        }
        assert!(serde_json::from_str::<Length>("-1").is_err());
    }
}
