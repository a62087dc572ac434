//! The simulator as a source of frames and readings.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use sps_dataset::{
    Description, Frame, FrameKey, LinearFrame, Origin, Property, PropertyRange, RollAngle, Source,
    SourceError, Surface, TactileTable, toccare,
};

use super::fingerprint;
use super::material::Material;
use super::parameters::{Parameters, Specimen};
use super::render::{self, Texels};
use super::spec::{MOST_SURFACES, SimulateError, SimulatorSpec};
use super::touch;

/// A simulated gonioreflectometer and tactile sensor.
///
/// Construction draws the surfaces and touches them; a view is rendered when it is asked for. The
/// last surfaces seen are kept built, so views of one surface are best asked for together.
#[derive(Debug)]
pub struct Simulator {
    spec: SimulatorSpec,
    name: String,
    specimens: Vec<Specimen>,
    surfaces: Vec<Surface>,
    angles: Vec<RollAngle>,
    tactile: TactileTable,
    built: Mutex<Vec<(usize, Arc<OnceLock<Texels>>)>>,
}

/// Built surfaces that are kept.
const KEPT: usize = 8;

impl Simulator {
    /// Draws and touches the surfaces of `spec`.
    ///
    /// # Errors
    /// [`SimulateError::Spec`] where a field is out of range.
    pub fn new(spec: SimulatorSpec) -> Result<Self, SimulateError> {
        let indices: Vec<usize> = (0..spec.surfaces.min(MOST_SURFACES + 1)).collect();
        Self::of(spec, &indices)
    }

    /// Draws and touches those surfaces of the seed that have these indices, in this order,
    /// instead of the first so many.
    ///
    /// ```
    /// use sps_dataset::Source;
    /// use sps_simulate::{Simulator, SimulatorSpec};
    ///
    /// let spec = SimulatorSpec { size: 32, ..SimulatorSpec::default() };
    /// let some = Simulator::of(spec.clone(), &[7, 500_000])?;
    /// let first = Simulator::new(SimulatorSpec { surfaces: 8, ..spec })?;
    /// assert_eq!(some.surfaces()[0], first.surfaces()[7]);
    /// assert_eq!(some.frame_key(0, 3)?, first.frame_key(7, 3)?);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`SimulateError::Spec`] where a field or an index is out of range.
    pub fn of(mut spec: SimulatorSpec, indices: &[usize]) -> Result<Self, SimulateError> {
        spec.surfaces = indices.len();
        let angles = spec.check()?;
        if let Some(&index) = indices.iter().find(|&&index| index >= MOST_SURFACES) {
            return Err(SimulateError::Surface {
                found: index,
                count: MOST_SURFACES,
            });
        }
        let draw = |&index: &usize| Specimen::draw(spec.seed, index);
        let specimens: Vec<Specimen> = indices.iter().map(draw).collect();
        let surface = |specimen: &Specimen| {
            let id = format!("s{:05}", specimen.index);
            Surface {
                group: id.clone(),
                id,
                material: specimen.material.label().to_owned(),
            }
        };
        let surfaces = specimens.iter().map(surface).collect();
        let tactile = touch::readings(&specimens, spec.locations, spec.repeats);
        Ok(Self {
            name: format!("simulated, seed {}", spec.seed),
            specimens,
            surfaces,
            angles,
            tactile,
            built: Mutex::new(Vec::new()),
            spec,
        })
    }

    /// What is simulated.
    pub fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    /// The material of one surface.
    ///
    /// # Errors
    /// [`SimulateError::Surface`] where there is no such surface.
    pub fn material(&self, surface: usize) -> Result<Material, SimulateError> {
        Ok(self.specimen(surface)?.material)
    }

    /// The physical parameters of one surface: what no dataset of photographs knows.
    ///
    /// # Errors
    /// [`SimulateError::Surface`] where there is no such surface.
    pub fn parameters(&self, surface: usize) -> Result<Parameters, SimulateError> {
        Ok(self.specimen(surface)?.parameters())
    }

    /// Renders one view as display-referred bytes: RGB, interleaved, row-major, what an 8-bit file
    /// holds and what [`Source::frame`] divides by 255.
    ///
    /// # Errors
    /// [`SimulateError::Surface`] or [`SimulateError::View`] where an index is out of range.
    pub fn frame_bytes(&self, surface: usize, view: usize) -> Result<Vec<u8>, SimulateError> {
        Ok(render::encode(&self.photograph(surface, view)?))
    }

    fn photograph(&self, surface: usize, view: usize) -> Result<LinearFrame, SimulateError> {
        let (specimen, size) = (self.specimen(surface)?, self.spec.size);
        let degrees = self.angle(view)?.0;
        let built = self.built(surface);
        let texels = built.get_or_init(|| render::prepare(specimen, size));
        Ok(render::photograph(specimen, texels, degrees, size))
    }

    fn specimen(&self, surface: usize) -> Result<&Specimen, SimulateError> {
        self.specimens.get(surface).ok_or(SimulateError::Surface {
            found: surface,
            count: self.specimens.len(),
        })
    }

    fn angle(&self, view: usize) -> Result<RollAngle, SimulateError> {
        self.angles.get(view).copied().ok_or(SimulateError::View {
            found: view,
            count: self.angles.len(),
        })
    }

    /// The place of a built surface, most recently used last; building happens outside the lock.
    fn built(&self, surface: usize) -> Arc<OnceLock<Texels>> {
        let mut built = self.built.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = match built.iter().position(|(kept, _)| *kept == surface) {
            Some(place) => built.remove(place),
            None => (surface, Arc::default()),
        };
        if built.len() >= KEPT.max(2 * rayon::current_num_threads()) {
            built.remove(0);
        }
        let texels = Arc::clone(&entry.1);
        built.push(entry);
        texels
    }
}

impl Source for Simulator {
    fn name(&self) -> &str {
        &self.name
    }

    fn origin(&self) -> Option<Origin> {
        Some(Origin::Simulator)
    }

    fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    fn view_angles(&self) -> &[RollAngle] {
        &self.angles
    }

    fn tactile(&self) -> &TactileTable {
        &self.tactile
    }

    /// 0 to 100 for all fifteen: a touch ends where the scale does.
    fn describe(&self, property: &Property) -> Description {
        Description {
            range: PropertyRange::try_from(toccare::NOMINAL_RANGE).ok(),
            ..Description::known(property)
        }
    }

    /// Rounded to 8 bits as a PNG is, so that a simulated set and its written copy are the same to
    /// the last bit.
    fn frame(&self, surface: usize, view: usize) -> Result<Frame, SourceError> {
        let bytes = self.frame_bytes(surface, view).map_err(SourceError::new)?;
        Ok(Frame {
            width: self.spec.size,
            height: self.spec.size,
            data: bytes.iter().map(|&b| f32::from(b) / 255.0).collect(),
        })
    }

    /// With the sensor's noise; highlights reach 4.
    fn linear_frame(
        &self,
        surface: usize,
        view: usize,
    ) -> Result<Option<LinearFrame>, SourceError> {
        let image = self.photograph(surface, view);
        image.map(Some).map_err(SourceError::new)
    }

    fn frame_key(&self, surface: usize, view: usize) -> Result<FrameKey, SourceError> {
        let specimen = self.specimen(surface).map_err(SourceError::new)?;
        let angle = self.angle(view).map_err(SourceError::new)?;
        Ok(fingerprint::frame_key(specimen, angle, self.spec.size))
    }
}
