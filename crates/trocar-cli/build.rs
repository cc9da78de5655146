//! Builds the library that `trocar export fmu` puts into an FMU, so that the program carries it
//! inside.

fn main() {
    trocar_fmu::library::embed("trocar export fmu");
}
