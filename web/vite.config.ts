import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";

const server = process.env.FOOTFALL_URL ?? "http://127.0.0.1:8080";

export default defineConfig({
  plugins: [react()],
  build: {
    // Fonts stay files of our own origin, so that a content security policy needs no `data:`.
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 900,
    rolldownOptions: {
      output: {
        codeSplitting: { groups: [{ name: "three", test: /node_modules\/(three|urdf-loader)\// }] },
      },
    },
  },
  server: { proxy: { "/api": { target: server, ws: true } } },
  test: { environment: "happy-dom", include: ["src/**/*.test.{ts,tsx}"] },
});
