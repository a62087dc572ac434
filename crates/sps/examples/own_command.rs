//! A program with a command of its own beside those of `sps`: `own_command greet`.

use std::process::ExitCode;

#[derive(clap::Subcommand)]
enum Command {
    #[command(flatten)]
    Sps(sps::Command),
    /// Say hello
    Greet,
}

fn main() -> ExitCode {
    sps::main("own_command", std::env::args_os(), |command| {
        match command {
            Command::Sps(command) => command.run()?,
            Command::Greet => println!("hello"),
        }
        Ok(())
    })
}
