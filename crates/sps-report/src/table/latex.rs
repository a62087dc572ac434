//! Tables for a paper, as LaTeX with booktabs.

use super::{Cell, Table};

impl Table {
    /// A float with a caption and the label `tab:NAME`.
    pub(crate) fn latex(&self) -> String {
        let alignment = |at| if self.is_left(at) { 'l' } else { 'r' };
        let alignment: String = (0..self.columns.len()).map(alignment).collect();
        let titles: Vec<String> = self.columns.iter().map(|title| escaped(title)).collect();
        let italic = |text: &str| format!("\\textit{{{text}}}");
        let rows = self.rows.iter().map(|row| line(&row.texts(text, italic)));
        format!(
            "% Needs \\usepackage{{booktabs}}.\n\
             \\begin{{table}}\n\
             \x20 \\centering\n\
             \x20 \\caption{{{title}. {caption}}}\n\
             \x20 \\label{{tab:{name}}}\n\
             \x20 \\begin{{tabular}}{{{alignment}}}\n\
             \x20   \\toprule\n\
             {head}\
             \x20   \\midrule\n\
             {rows}\
             \x20   \\bottomrule\n\
             \x20 \\end{{tabular}}\n\
             \\end{{table}}\n",
            title = escaped(&self.title),
            caption = escaped(&self.caption),
            name = self.name,
            head = line(&titles),
            rows = rows.collect::<String>(),
        )
    }
}

fn line(cells: &[String]) -> String {
    format!("    {} \\\\\n", cells.join(" & "))
}

fn text(cell: &Cell) -> String {
    let text = cell.to_string();
    if cell.is_text {
        return escaped(&text);
    }
    // A hyphen is no minus sign.
    escaped(&text.replace('-', "−"))
}

/// With what LaTeX would read as a command written so that it prints. After the end of a line a
/// bracket or an asterisk would be its argument.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for char in text.chars() {
        match char {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', char]),
            '[' | ']' | '*' => escaped.extend(['{', char, '}']),
            '\\' => escaped.push_str("\\textbackslash{}"),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            '|' => escaped.push_str("\\textbar{}"),
            '²' => escaped.push_str("$^2$"),
            '°' => escaped.push_str("$^\\circ$"),
            '±' => escaped.push_str("$\\pm$"),
            '▲' => escaped.push_str("$\\uparrow$"),
            '▼' => escaped.push_str("$\\downarrow$"),
            '●' => escaped.push_str("$\\bullet$"),
            '…' => escaped.push_str("\\dots{}"),
            '–' => escaped.push_str("--"),
            '−' => escaped.push_str("$-$"),
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::super::hard_cases;
    use super::*;

    #[test]
    fn names_and_missing_values_are_printed_as_they_are() {
        let text = hard_cases().latex();
        for line in [
            "  \\caption{50 \\% of R$^2$ \\& more. See `a\\_b`.}",
            "  \\label{tab:hard-cases}",
            "  \\begin{tabular}{lrr}",
            "    Method & R$^2$ & paper \\\\",
            "    Ridge\\_1 \\& 5 \\%, \"wide\" & $-$0.25 {[}$-$0.50, 0.75{]} & -- \\\\",
            "    {[}a{]} \\textbar{} b & -- & 0.5 \\\\",
            "    \\textit{Ceiling} & \\textit{0.33} &  \\\\",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in {text}");
        }
    }

    #[test]
    fn no_character_is_a_command() {
        assert_eq!(
            escaped(r"\{}$#^~<>*"),
            r"\textbackslash{}\{\}\$\#\textasciicircum{}\textasciitilde{}\textless{}\textgreater{}{*}"
        );
    }
}
