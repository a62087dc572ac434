//! One module per subcommand: its arguments, and `run`.

pub(crate) mod compare;
pub(crate) mod completions;
pub(crate) mod embed;
pub(crate) mod experiment;
pub(crate) mod fit;
pub(crate) mod import;
pub(crate) mod inspect;
pub(crate) mod list;
pub(crate) mod man;
pub(crate) mod map;
pub(crate) mod predict;
pub(crate) mod report;
pub(crate) mod serve;
pub(crate) mod simulate;
pub(crate) mod suggest;
