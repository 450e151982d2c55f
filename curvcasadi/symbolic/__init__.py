"""CasADi expressions: their types and checks, named Functions, named parts of vectors."""
