import js from "@eslint/js";
import hooks from "eslint-plugin-react-hooks";
import tseslint from "typescript-eslint";

export default tseslint.config(
  { ignores: ["dist", "test-results", "playwright-report", "src/api/schema.d.ts"] },
  js.configs.recommended,
  ...tseslint.configs.recommended,
  { ...hooks.configs.flat["recommended-latest"], files: ["src/**/*.{ts,tsx}"] },
  {
    files: ["conformance/**"],
    languageOptions: {
      globals: {
        Buffer: "readonly",
        TextDecoder: "readonly",
        WebSocket: "readonly",
        console: "readonly",
        process: "readonly",
      },
    },
  },
  { rules: { "max-lines": ["error", { max: 400, skipBlankLines: true, skipComments: true }] } },
);
