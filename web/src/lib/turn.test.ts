import { expect, test } from "vitest";

import type { Vec3 } from "../api/types";
import { aboutContact, axisOf, headingOf, rotated } from "./turn";

const close = (a: Vec3, b: Vec3) => a.forEach((v, i) => expect(v).toBeCloseTo(b[i]!, 12));

test("quarter turns of the axes", () => {
  close(rotated([1, 0, 0], [0, 0, 1], Math.PI / 2), [0, 1, 0]);
  close(rotated([0, 1, 0], [1, 0, 0], Math.PI / 2), [0, 0, 1]);
  close(rotated([0, 0, 1], [0, 1, 0], Math.PI / 2), [1, 0, 0]);
});

test("about the vertical a center above its contact stays", () => {
  const { position_m, rotation_rad } = aboutContact([3, 1, 0.264], [3, 1, 0], [0, 0, 1], 0.3);
  close(position_m, [0, 0, 0]);
  close(rotation_rad, [0, 0, 0.3]);
});

test("leaning, the center goes sideways by the radius and the contact stays", () => {
  // A wheel that heads along x leans to its right for a positive turn about x: the center goes to -y.
  const { position_m } = aboutContact([0, 0, 0.264], [0, 0, 0], axisOf("heading", 0), 0.2);
  close(position_m, [0, -0.264 * Math.sin(0.2), 0.264 * (Math.cos(0.2) - 1)]);
});

test("whatever the axis, the contact as carried by the wheel is where it was", () => {
  const [center, contact] = [[1, 2, 0.5] as Vec3, [1.1, 1.95, 0.24] as Vec3];
  for (const axis of [axisOf("up", 1), axisOf("heading", 1), axisOf("axle", 1)]) {
    const { position_m } = aboutContact(center, contact, axis, 0.4);
    const carried = rotated(contact.map((v, i) => v - center[i]!) as Vec3, axis, 0.4);
    close(center.map((v, i) => v + position_m[i]! + carried[i]!) as Vec3, contact);
  }
});

test("the axle points to the left of where a wheel heads", () => {
  close(axisOf("axle", 0), [0, 1, 0]);
  close(axisOf("axle", Math.PI / 2), [-1, 0, 0]);
});

test("the heading of a base turned about the vertical", () => {
  expect(headingOf([0, 0, Math.sin(0.35), Math.cos(0.35)])).toBeCloseTo(0.7, 12);
  expect(headingOf([0.1, 0, 0, Math.sqrt(0.99)])).toBeCloseTo(0, 12);
});
