import { defineConfig } from "@playwright/test";

// The server is started by whoever runs the tests; FOOTFALL_URL says where it listens.
export default defineConfig({
  testDir: "e2e",
  workers: 1,
  retries: 0,
  forbidOnly: true,
  timeout: 120_000,
  expect: { timeout: 20_000 },
  use: {
    baseURL: process.env.FOOTFALL_URL ?? "http://127.0.0.1:8080",
    viewport: { width: 1440, height: 900 },
    deviceScaleFactor: 1,
    trace: "off",
    launchOptions: {
      executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
      chromiumSandbox: false,
      args: ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
    },
  },
});
