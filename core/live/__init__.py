"""The live page: what it shows (scene), who looks (viewers), and the server between them."""
