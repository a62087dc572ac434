/// The one of `known` that `typed` probably stands for: equal but for case, or a typing slip away.
pub(crate) fn nearest<'a>(
    typed: &str,
    known: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let typed = typed.to_lowercase();
    let slips = (typed.chars().count() / 3).clamp(1, 3);
    known
        .into_iter()
        .map(|name| (strsim::osa_distance(&typed, &name.to_lowercase()), name))
        .filter(|(distance, _)| *distance <= slips)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn finds_case_slips_and_typing_slips_only() {
        let known = ["properties", "description", "source"];
        assert_eq!(nearest("propertes", known), Some("properties"));
        assert_eq!(nearest("Source", known), Some("source"));
        assert_eq!(nearest("decsription", known), Some("description"));
        assert_eq!(nearest("angles", known), None);
        assert_eq!(nearest("", known), None);
    }
}
