//! How the networks of a run were trained: their loss, epoch by epoch.

use kuva::plot::LegendPosition;
use kuva::plot::line::LinePlot;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use sps_experiment::results::Results;

use super::figures::{Figure, PAGE, plotted, told_apart};

/// The loss of each network's estimates in training; none where no network was trained.
pub(super) fn figure(results: &Results) -> Option<Figure> {
    let trained = results.methods.iter();
    let trained = trained.filter(|method| !method.training_losses.is_empty());
    let mut plots: Vec<Plot> = Vec::new();
    for (index, method) in trained.enumerate() {
        let epochs = (1_u32..).map(f64::from);
        let line = LinePlot::new()
            .with_data(epochs.zip(method.training_losses.iter().copied()))
            .with_stroke_width(1.4);
        plots.push(told_apart(line, index, &method.label));
    }
    if plots.is_empty() {
        return None;
    }
    let layout = Layout::auto_from_plots(&plots)
        .with_y_axis_min(0.0)
        .with_x_label("epoch")
        .with_y_label("squared error in training")
        .with_legend_box(false)
        .with_legend_position(LegendPosition::OutsideBottomColumns);
    Some(Figure {
        name: "training",
        title: "How networks were trained".to_owned(),
        caption: "Mean squared error of the estimates in training, in units of the readings' variance, over \
                  all properties and reruns."
            .to_owned(),
        svg: plotted(plots, layout, (PAGE, 320.0)),
    })
}
