// Nothing: the first pass over the surfaces only finds out which is in front.
#version 430 core

void main() {}
