//! In place of networks, where this build reads none.

use crate::error::ErrorKind;

pub(crate) enum Graph {}

impl Graph {
    pub(crate) fn load(_: &[u8], _: &[String]) -> Result<Self, ErrorKind> {
        Err(ErrorKind::NotBuilt)
    }

    pub(crate) fn size(&self) -> Option<usize> {
        match *self {}
    }

    pub(crate) fn outputs(&self) -> Vec<String> {
        match *self {}
    }

    pub(crate) fn each(
        &self,
        _: usize,
        _: usize,
        _: impl Fn(usize) -> Vec<f32>,
    ) -> Result<Vec<Vec<Vec<f32>>>, ErrorKind> {
        match *self {}
    }
}
