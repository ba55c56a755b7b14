//! Curves of weights in a CSV file: a column for every shape, a line for every frame.

use crate::frames::{FramesProblem, NamedWeights, Place, Wrong};
use std::collections::HashMap;
use std::rc::Rc;

/// Name of the first column where it names the frames.
const NAMES: &str = "frame";

/// Frames of a CSV text. With `names_column`, a first column called `frame` holds names instead of weights. Lines without any cell are
/// passed over.
///
/// # Errors
/// With the line, when columns are unnamed, named twice or not parted by commas, a row is ragged, or a cell is no number.
pub(crate) fn parse(text: &str, names_column: bool) -> Result<Vec<NamedWeights>, Wrong> {
    let lines = text.lines().enumerate();
    let mut lines = lines.filter(|(_, line)| !line.trim().is_empty());
    let Some((first, header)) = lines.next() else {
        return Ok(Vec::new());
    };
    let at_header = Place::Line(first + 1);
    let columns = match header_columns(header) {
        Ok(columns) => columns,
        Err(problem) => return Err((at_header, problem)),
    };
    let named = names_column && &*columns[0] == NAMES;
    if named && columns.len() == 1 {
        return Err((at_header, FramesProblem::NoShapes));
    }
    let mut frames = Vec::new();
    for (i, line) in lines {
        let place = Place::Line(i + 1);
        let frame = row(line, &columns, named).map_err(|problem| (place.clone(), problem))?;
        let (name, weights) = frame;
        frames.push(NamedWeights {
            name,
            weights,
            place,
        });
    }
    Ok(frames)
}

fn header_columns(line: &str) -> Result<Vec<Rc<str>>, FramesProblem> {
    let columns: Vec<Rc<str>> = cells(line)?.into_iter().map(Rc::from).collect();
    if let ([_], Some(found)) = (columns.as_slice(), other_separator(line)) {
        return Err(FramesProblem::Separator { found });
    }
    // Comparing each with each would take minutes for a line of a megabyte.
    let mut seen = HashMap::new();
    for (i, name) in columns.iter().enumerate() {
        if name.is_empty() {
            return Err(FramesProblem::UnnamedColumn { column: i + 1 });
        }
        if let Some(first) = seen.insert(name, i) {
            return Err(FramesProblem::RepeatedColumn {
                name: name.to_string(),
                first: first + 1,
                second: i + 1,
            });
        }
    }
    Ok(columns)
}

/// What spreadsheets put between columns where the comma is the decimal sign.
fn other_separator(line: &str) -> Option<&'static str> {
    let known = [(';', "semicolons"), ('\t', "tabs")];
    let found = known.into_iter().find(|(mark, _)| line.contains(*mark));
    found.map(|(_, name)| name)
}

/// The names of columns are shared: a cell of two bytes must not cost a name.
type Row = (Option<String>, Vec<(Rc<str>, f64)>);

fn row(line: &str, columns: &[Rc<str>], named: bool) -> Result<Row, FramesProblem> {
    let cells = cells(line)?;
    if cells.len() != columns.len() {
        return Err(FramesProblem::RaggedRow {
            found: cells.len(),
            expected: columns.len(),
        });
    }
    let first = usize::from(named);
    let name = named.then(|| cells[0].clone()).filter(|n| !n.is_empty());
    let weights = columns[first..].iter().zip(&cells[first..]);
    let weights = weights.map(|(shape, text)| match text.parse() {
        Ok(weight) => Ok((shape.clone(), weight)),
        Err(_) => Err(FramesProblem::NotANumber {
            shape: shape.to_string(),
            text: text.clone(),
        }),
    });
    Ok((name, weights.collect::<Result<_, _>>()?))
}

/// Cells of a line, by RFC 4180 without line breaks inside of quotes; spaces around a cell go.
fn cells(line: &str) -> Result<Vec<String>, FramesProblem> {
    let mut cells = Vec::new();
    let mut cell = String::new();
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                cell.push('"');
            }
            '"' if quoted || cell.trim().is_empty() => quoted = !quoted,
            ',' if !quoted => cells.push(std::mem::take(&mut cell)),
            _ => cell.push(c),
        }
    }
    if quoted {
        return Err(FramesProblem::Quote);
    }
    cells.push(cell);
    Ok(cells.iter().map(|cell| cell.trim().to_string()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(text: &str) -> Vec<(Option<String>, Vec<f64>)> {
        let frames = parse(text, true).unwrap();
        let plain = |f: NamedWeights| (f.name, f.weights.iter().map(|w| w.1).collect());
        frames.into_iter().map(plain).collect()
    }

    #[test]
    fn lines_are_frames() {
        let unnamed = vec![(None, vec![0.0, 1.0]), (None, vec![0.5, 1e-3])];
        assert_eq!(weights("a,b\n0,1\n0.5,1e-3\n"), unnamed);
        assert_eq!(weights("a , b\r\n\r\n 0,1 \r\n0.5, 1e-3\r\n\r\n"), unnamed);
        let named = vec![(Some("one, two".into()), vec![0.0]), (None, vec![1.0])];
        assert_eq!(weights("frame,a\n\"one, two\",0\n,1\n"), named);
        assert_eq!(weights("a\n"), []);
        let quoted = parse("\"a\"\"b\", \"c\"\n0,1", true).unwrap();
        let names: Vec<&str> = quoted[0].weights.iter().map(|w| &*w.0).collect();
        assert_eq!(names, ["a\"b", "c"]);
        assert_eq!(quoted[0].place, Place::Line(2));
        let shape = parse("frame,a\n0,1", false).unwrap();
        assert_eq!(shape[0].weights.len(), 2);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        use FramesProblem::*;
        let ragged = |found| RaggedRow { found, expected: 2 };
        let number = |text: &str| NotANumber {
            shape: "b".into(),
            text: text.into(),
        };
        let repeated = RepeatedColumn {
            name: "a".into(),
            first: 1,
            second: 3,
        };
        for (text, line, problem) in [
            ("a,b\n0,1\n0\n", 3, ragged(1)),
            ("a,b\n\n0,1,\n", 3, ragged(3)),
            ("a,b\n0,\n", 2, number("")),
            ("a,b\n0,x\n", 2, number("x")),
            ("a,b\n0,0.5 cm\n", 2, number("0.5 cm")),
            ("a,b,a\n0,0,0\n", 1, repeated),
            ("a,\n0,0\n", 1, UnnamedColumn { column: 2 }),
            ("\n,a\n0,0\n", 2, UnnamedColumn { column: 1 }),
            (
                "a;b\n0;0\n",
                1,
                Separator {
                    found: "semicolons",
                },
            ),
            ("a\tb\n0\t0\n", 1, Separator { found: "tabs" }),
            ("\"a,b\n0,0\n", 1, Quote),
            ("frame\none\n", 1, NoShapes),
        ] {
            assert_eq!(
                parse(text, true),
                Err((Place::Line(line), problem)),
                "{text}"
            );
        }
    }
}
