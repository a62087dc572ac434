//! Which names are taken for slips of which.

use sps_base::names::{UnknownName, nearest};

#[test]
fn finds_case_slips_and_typing_slips_only() {
    let known = ["properties", "description", "source"];
    assert_eq!(nearest("propertes", known), Some("properties"));
    assert_eq!(nearest("Source", known), Some("source"));
    assert_eq!(nearest("decsription", known), Some("description"));
    assert_eq!(nearest("angles", known), None);
    assert_eq!(nearest("", known), None);
}

#[test]
fn other_messages_of_serde_are_about_no_name() {
    for message in ["missing field `seed`", "unknown field", "invalid type: map"] {
        assert_eq!(UnknownName::of_serde(message), None);
    }
    let none = UnknownName::of_serde("unknown field `x`, there are no fields");
    let expected = "unknown key `x`, which is not one of those known";
    assert_eq!(none.map(|name| name.to_string()).as_deref(), Some(expected));
}
