//! Names out of files, fit for a terminal and a page.

use std::borrow::Cow;

/// A text with its control characters written as escapes (`\n`, `\u{1b}`), and those that turn the direction of writing.
///
/// Names of shapes, bones and files come from whoever made the file. Printed as they are they could move the cursor, clear the screen, change
/// the window's title, or pass for another line of output.
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(does_more_than_print) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        match does_more_than_print(c) {
            true => out.extend(c.escape_default()),
            false => out.push(c),
        }
    }
    Cow::Owned(out)
}

fn does_more_than_print(c: char) -> bool {
    const TURNS: [char; 3] = ['\u{61c}', '\u{200e}', '\u{200f}'];
    let breaks_or_turns = matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || breaks_or_turns || TURNS.contains(&c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_a_cursor_is_escaped_and_letters_are_not() {
        for (text, shown) in [
            ("smile_L", "smile_L"),
            ("L\u{e4}cheln \u{1f600} `\\`", "L\u{e4}cheln \u{1f600} `\\`"),
            ("\u{1b}[2Jgone", "\\u{1b}[2Jgone"),
            ("a\nerror: b\r\t\0", "a\\nerror: b\\r\\t\\u{0}"),
            ("\u{9b}31m\u{7f}", "\\u{9b}31m\\u{7f}"),
            ("gnp.\u{202e}exe\u{2028}", "gnp.\\u{202e}exe\\u{2028}"),
        ] {
            assert_eq!(printable(text), shown);
        }
        assert!(matches!(printable("plain"), Cow::Borrowed(_)));
    }
}
