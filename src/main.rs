//! The `vpm-vdb` command: parse, run, print the error chain once, exit code.

mod cli;
mod engine;
mod run;
mod run_study;
mod run_tools;

use std::process::ExitCode;

/// Bad input: the command line (clap exits with the same), a file, a scene.
const BAD_INPUT: u8 = 2;

fn main() -> ExitCode {
    let cli = cli::parse();
    match run::run(&cli) {
        Ok(code) => code,
        // Whoever read our output, such as `head`, has read enough.
        Err(e) if run::is_broken_pipe(&e) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {}", chain(&e));
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// The error and its causes, less those that the line already has.
fn chain(e: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in e.chain().map(ToString::to_string) {
        if line.is_empty() {
            line = cause;
        } else if !line.ends_with(&cause) {
            line += &format!(": {cause}");
        }
    }
    line
}
