use super::*;

#[test]
fn the_papers_settings_are_the_defaults() {
    let config = HeadConfig::default();
    assert_eq!(config.epochs, 30);
    assert_eq!(config.adam.learning_rate, 1e-4);
    assert_eq!(config.early_stopping, None);
    let Model::CrossModal(model) = config.model else {
        panic!("not the cross-modal network")
    };
    assert_eq!(model.latent, 50);
}

#[test]
fn a_configuration_reads_and_writes_as_toml() {
    let text = r#"
        batch-size = 4
        clip-norm = 1.0
        scale = "per-feature"
        input = { kind = "late-fusion", views = 3 }

        [model]
        kind = "cross-modal"
        latent = 100
        adversarial = { weight = 0.5 }
        classification = { labels = { source = "tactile-cluster", clusters = 8 } }

        [adam]
        learning-rate = 1e-3
        weight-decay = 0.1

        [early-stopping]
        patience = 5
    "#;
    let config: HeadConfig = toml::from_str(text).unwrap();
    assert_eq!(config.batch_size, 4);
    assert_eq!(config.epochs, 30);
    assert_eq!(config.input, Input::LateFusion { views: 3 });
    assert_eq!(config.adam.weight_decay, 0.1);
    let expected = EarlyStopping {
        patience: 5,
        validation: 0.15,
    };
    assert_eq!(config.early_stopping, Some(expected));
    let again = toml::to_string(&config).unwrap();
    assert_eq!(toml::from_str::<HeadConfig>(&again).unwrap(), config);
    let regression = "model = { kind = \"regression\" }";
    let config: HeadConfig = toml::from_str(regression).unwrap();
    assert_eq!(config.model, Model::Regression {});
}

#[test]
fn a_misspelt_key_is_refused_at_every_level() {
    for text in [
        "epoch = 3",
        "adam = { learning_rate = 1e-3 }",
        "early-stopping = { epochs = 3 }",
        "input = { kind = \"single\", views = 1 }",
        "model = { kind = \"regression\", latent = 50 }",
        "model = { kind = \"cross-modal\", latents = 50 }",
        "model = { kind = \"cross-modal\", adversarial = { weights = 1.0 } }",
        "model = { kind = \"cross-modal\", classification = { weight = 1.0 } }",
    ] {
        assert!(toml::from_str::<HeadConfig>(text).is_err(), "{text}");
    }
}

#[test]
fn each_value_out_of_range_is_named() {
    // Most are named by what stands before the first ` = `. Of Adam's settings one
    // stands for all; the others are in `optim/tests.rs`.
    let named = |text: &'static str| (text, text.split(" = ").next().unwrap());
    let simple = [
        "epochs = 0",
        "batch-size = 0",
        "clip-norm = 0.0",
        "clip-norm = nan",
        "adam.beta2 = -0.1",
        "early-stopping.validation = 0.0",
        "early-stopping.validation = 1.0",
        "model.latent = 0",
        "model.hidden = 0",
        "model.embedding-weight = -1.0",
        "model.embedding-weight = nan",
        "model.adversarial.weight = 0.0",
        "model.adversarial.hidden = 0",
    ];
    let fusion = "input = { kind = \"late-fusion\", views = 0 }";
    let weight = "model.classification = { weight = 0.0, labels.source = \"material\" }";
    let clusters = "model.classification.labels = { source = \"tactile-cluster\", clusters = 0 }";
    let others = [
        (fusion, "input.views"),
        (weight, "model.classification.weight"),
        (clusters, "clusters"),
    ];
    for (text, key) in simple.map(named).into_iter().chain(others) {
        let kind = if text.starts_with("model") {
            "model.kind = \"cross-modal\""
        } else {
            ""
        };
        let config: HeadConfig = toml::from_str(&format!("{text}\n{kind}")).unwrap();
        let message = Head::new(config).unwrap_err().to_string();
        let named = message.starts_with(&format!("{key}: found "));
        assert!(named, "{text}: {message}");
    }
}
